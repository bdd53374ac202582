"""How many loops are tried and how strictly they are judged: the thresholds of loop closing."""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How many loops are searched for, and how strictly they are judged.

    Attributes:
        per_scan: most loops of a round that one scan takes part in; 0 searches none.
        rounds: how often loops are searched for, whatever is known; later rounds use the estimate that earlier loops
            have improved.
        most_rounds: so often at most, as long as there are scans whose lie to each other the estimate has no better
            than this survey's registrations usually have it.
        min_overlap: expected overlap that makes a pair a candidate, 0..1.
        cell_voxels: edge of the cells in which overlap is predicted [voxels]: coarse, as the estimate has
            drifted.
        spread: a scan's loops lead to scans more than this apart, so that its neighbors do not take them all.
        bound: largest distance of two answers that agree [sigmas]; 4.74 holds 99.9 % of right ones (six degrees of
            freedom).
        floor_rotation, floor_voxels: an uncertainty that every answer is granted, added in quadrature [rad,
            voxels].
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
            raise InputError("cell_voxels and bound have to be positive, the floors not negative")

    def floor(self, voxel: float) -> np.ndarray:
        """(6,) standard deviations that every answer is granted [rad, m]."""
        return np.repeat([self.floor_rotation, self.floor_voxels * voxel], 3)
