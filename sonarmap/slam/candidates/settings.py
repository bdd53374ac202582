"""Settings of loop closing."""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Number of loops that are tried, and thresholds for accepting them.

    Attributes:
        per_scan: largest number of loops per scan and round; 0 searches none.
        rounds: number of searches for loops; later rounds use the estimate that earlier loops have improved.
        most_rounds: largest number of searches; those after `rounds` try only pairs whose relative pose the estimate
            knows no better than this survey's registrations usually do.
        min_overlap: expected overlap from which a pair is a candidate, 0..1; a third of it if instruments measured
            attitude, heading, depth and position of both scans.
        cell_voxels: edge of the cells in which overlap is predicted [voxels]: coarse, as the estimate drifts.
        spread: a scan's loops lead to scans more than this apart in number, so that neighbors do not take all of them.
        bound: largest distance of two answers that agree [sigmas]; 4.74 includes 99.9 % of right ones (six degrees of
            freedom).
        floor_rotation, floor_voxels: standard deviations added in quadrature to every answer's [rad, voxels].
    """

    per_scan: int = 2
    rounds: int = 2
    most_rounds: int = 8
    min_overlap: float = 0.1
    cell_voxels: float = 4.0
    spread: int = 2
    bound: float = 4.74
    floor_rotation: float = float(np.radians(1.0))
    floor_voxels: float = 1.0

    def __post_init__(self) -> None:
        if min(self.per_scan, self.spread, self.rounds) < 0:
            raise InputError(
                f"per_scan {self.per_scan}, rounds {self.rounds} and spread {self.spread}: wanted 0 or more of each"
            )
        if not 0 < self.min_overlap <= 1:
            raise InputError(f"min_overlap is {self.min_overlap}; wanted more than 0 and at most 1")
        if self.most_rounds < self.rounds:
            raise InputError(f"most_rounds {self.most_rounds}: wanted at least the {self.rounds} of rounds")
        if min(self.cell_voxels, self.bound) <= 0 or min(self.floor_rotation, self.floor_voxels) < 0:
            raise InputError("cell_voxels and bound must be above 0, floor_rotation and floor_voxels 0 or more")

    def floor(self, voxel: float) -> np.ndarray:
        """(6,) standard deviations added to every answer's [rad, m]."""
        return np.repeat([self.floor_rotation, self.floor_voxels * voxel], 3)
