"""Scans with their poses and their beams, from which every map is made."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform
from scipy.special import ndtri

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.cell import lattice_origin
from sonarmap.spectral.prepare.range_image import SINGLE, SLOPE, SPREAD
from sonarmap.spectral.scan import Scan

_SAMPLE = 750  # beams of a scan that are compared with their neighbors
_NEIGHBORS = 11  # of a beam, by direction
_MIN_SCATTER = 0.02  # of a range [voxels], as no surface is flat


@dataclass(frozen=True, slots=True)
class Beams:
    sigma: float  # standard deviation of a range about those of its neighbors [m]
    spacing: float  # median angle between neighboring beams [rad]
    # whether the points were seen from the origin; false for a map, or a sweep put together from several viewpoints
    single: bool


@dataclass(frozen=True, slots=True)
class PlacedScans:
    """S scans with estimated poses, and the voxel of the map to fuse them into."""

    scans: tuple[Scan, ...]  # S of them, at least one
    T_world_sensor: RigidTransform  # their S poses
    voxel: float  # edge of the map's voxels [m]
    beams: tuple[Beams, ...]  # S, as measured from the scans
    indices: tuple[int, ...]  # the scans' indices in the survey
    surveys: tuple[int, ...]  # the number of each scan's survey
    covariances: np.ndarray  # (S, 6, 6) of the poses, rotation first [rad, m], body tangent; 0 where they are certain

    def __post_init__(self) -> None:
        per_scan: dict[str, Sized] = {"poses": self.T_world_sensor}
        per_scan |= {name: getattr(self, name) for name in ("beams", "indices", "surveys", "covariances")}
        for name, values in per_scan.items():
            if not self.scans or len(values) != len(self.scans):
                raise InputError(f"{len(self.scans)} scans and {len(values)} {name}: wanted scans, and one per scan")
        if not (np.isfinite(self.voxel) and self.voxel > 0):
            raise InputError(f"the map's voxel is {self.voxel} m; wanted a positive length")

    @classmethod
    def of(
        cls,
        scans: Sequence[Scan],
        T_world_sensor: RigidTransform,
        voxel: float,
        indices: Sequence[int] | None = None,
        covariances: np.ndarray | None = None,
        surveys: Sequence[int] | None = None,
    ) -> PlacedScans:
        """Scans with measured beams; by default with the indices 0..S-1, of one survey, and with certain poses."""
        return cls(
            tuple(scans),
            T_world_sensor,
            voxel,
            tuple(beams_of(scan.points, voxel) for scan in scans),
            tuple(range(len(scans)) if indices is None else indices),
            (0,) * len(scans) if surveys is None else tuple(surveys),
            np.zeros((len(scans), 6, 6)) if covariances is None else covariances,
        )

    def take(self, chosen: Sequence[int]) -> PlacedScans:
        """The scans at these positions, in their order."""
        return replace(
            self,
            scans=tuple(self.scans[k] for k in chosen),
            T_world_sensor=self.T_world_sensor[list(chosen)],
            beams=tuple(self.beams[k] for k in chosen),
            indices=tuple(self.indices[k] for k in chosen),
            surveys=tuple(self.surveys[k] for k in chosen),
            covariances=self.covariances[list(chosen)],
        )

    @property
    def origin(self) -> np.ndarray:
        """(3,) [m, world], the origin of the map's lattice, near the median of the first scan."""
        return lattice_origin(self.T_world_sensor[0].apply(self.scans[0].points.astype(np.float64)), self.voxel)

    @property
    def by_survey(self) -> dict[int, PlacedScans]:
        """Each survey's scans by its number, ascending; empty if there is only one survey."""
        surveys = np.array(self.surveys)
        numbers = np.unique(surveys).tolist()
        return {k: self.take(np.flatnonzero(surveys == k).tolist()) for k in numbers} if len(numbers) > 1 else {}


def beams_of(points: np.ndarray, voxel: float) -> Beams:
    """Measure a scan's beams from a sample of them: how far a range is from the median of its neighbors'.

    Edges and beams that are false echoes do not move the median.

    Args:
        points: (N, 3) float [m, sensor frame].
        voxel: of the map [m].
    """
    points = points.astype(np.float64)
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    anywhere = Beams(voxel / np.sqrt(12), 0.0, single=False)  # a point may lie anywhere in its voxel
    if len(points) <= _NEIGHBORS or not ranges.min() > 0:
        return anywhere
    directions = points / ranges[:, None]
    sample = np.arange(0, len(points), -(-len(points) // _SAMPLE))
    # balancing the tree costs more than it saves in a single query
    tree = KDTree(directions, leafsize=32, compact_nodes=False, balanced_tree=False)
    angles, near = tree.query(directions[sample], _NEIGHBORS)
    off = np.abs(ranges[sample] - np.median(ranges[near[:, 1:]], axis=1))
    if (off <= SPREAD * voxel + SLOPE * ranges[sample]).mean() < SINGLE:
        return anywhere
    of_difference = np.sqrt(1 + np.pi / 2 / (_NEIGHBORS - 1))  # the median of the others errs too
    sigma = max(float(np.median(off)) / ndtri(0.75) / of_difference, _MIN_SCATTER * voxel)
    return Beams(sigma, float(np.median(angles[:, 1])), single=True)


def pose_variance(points: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(N,) float64 [m^2]: variance of points by the pose's covariance, the mean over the three coordinates.

    With T_true = T Exp((w, v)) a point p moves by R (w x p + v): a third of the trace of that vector's covariance,
    which no rotation R changes.

    Args:
        points: (N, 3) float64 [m, sensor frame].
        covariance: (6, 6) of (w, v), rotation first [rad, m].
    """
    turn, cross, shift = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
    twisted = np.trace(turn) * np.eye(3) - turn  # |w x p|^2 is p' (w'w I - w w') p
    # (w x p) . v is p . (v x w)
    lever = np.array([cross[2, 1] - cross[1, 2], cross[0, 2] - cross[2, 0], cross[1, 0] - cross[0, 1]])
    squares = np.einsum("ni,ni->n", points @ twisted, points) + 2 * points @ lever + np.trace(shift)
    return np.maximum(squares, 0.0) / 3
