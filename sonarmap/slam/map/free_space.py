"""What every scan says of every point of a map, and which points free space contradicts: beams passed them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.points.visibility import octahedral_cells
from sonarmap.slam.map.beams import Beams, beams_of
from sonarmap.slam.map.fused_cells import pose_variance
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.map.tiles import Tiles
from sonarmap.slam.map.view import View, view_of
from sonarmap.spectral.scan import Scan

# A point contradicts a view if it lies nearer than everything about its direction by more than this: so many voxels,
# this share of the range, and so many standard deviations.
_REACH, _SLOPE, _SIGMAS = 1.0, 0.03, 2.0
_LEAST = 2  # scans that have to contradict a point


@dataclass(frozen=True, slots=True)
class Votes:
    """What the scans say about each point of a map.

    Attributes:
        agree: (M,) int32, scans whose nearest surface in that direction is there.
        contradict: (M,) int32, scans whose beams passed there and met something farther off.
        looked: (M,) int32, scans whose beams went that way, close together: they met the point, passed it, or met
            something before it.
        behind: (M,) bool, whether the view of the scan that saw most of the point shows something nearer all about it.
    """

    agree: np.ndarray
    contradict: np.ndarray
    looked: np.ndarray
    behind: np.ndarray

    def take(self, chosen: np.ndarray) -> "Votes":
        """These points' alone."""
        return Votes(self.agree[chosen], self.contradict[chosen], self.looked[chosen], self.behind[chosen])


def uncontradicted(point_map: PointMap, vote: Votes) -> np.ndarray:
    """The points that free space does not contradict, (M,) bool.

    A point goes if at least two scans contradict it, more than agree with it, and more than have a point in its voxel.
    What no beam passed cannot be contradicted: echoes from behind a surface, as of multipath, stay.
    """
    support = np.maximum(vote.agree, point_map.seen)
    return (vote.contradict < _LEAST) | (vote.contradict <= support)


def votes(
    point_map: PointMap,
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    covariances: np.ndarray | None = None,
    beams: Sequence[Beams] | None = None,
    indices: Sequence[int] | None = None,
) -> Votes:
    """Ask every scan that was seen from one viewpoint about every point of the map that its view takes in.

    Args:
        point_map: fused from the scans.
        scans: S of them.
        T_world_sensor: their S poses, in the map's frame.
        covariances: (S, 6, 6) of the poses, rotation first [rad, m], body tangent; certain without.
        beams: of the scans, where they are known already.
        indices: what `PointMap.scan` calls the scans; 0..S-1 by default.
    """
    agree, contradict, looked = np.zeros((3, len(point_map.points)), np.int32)
    behind = np.zeros(len(point_map.points), bool)
    tiles: Tiles | None = None
    for k, scan in enumerate(scans):
        scan_beams = beams_of(scan.points, point_map.voxel) if beams is None else beams[k]
        if not scan_beams.single:
            continue
        view = view_of(scan, scan_beams)
        tiles = tiles or Tiles.of(point_map.points, view.reach)
        T = T_world_sensor[k]
        near = tiles.within(T.translation, view.reach)
        local = T.inv().apply(point_map.points[near])
        directions = view.R_view_sensor.apply(local)
        unsure = point_map.sigma[near].astype(np.float64) ** 2
        if covariances is not None:
            unsure += pose_variance(local, covariances[k])
        seen, passed, asked = _ask(view, local, directions, np.sqrt(unsure), point_map.voxel)
        agree[near] += seen
        contradict[near] += passed
        looked[near] += asked
        own = np.flatnonzero(point_map.scan[near] == (k if indices is None else indices[k]))
        ranges = np.linalg.norm(local[own], axis=1)  # in its own view a point errs by its range alone
        ranges -= _tolerance(ranges, scan_beams.sigma(ranges), point_map.voxel)
        behind[near[own]] = view.behind(directions[own], ranges)
    return Votes(agree, contradict, looked, behind)


def _ask(
    view: View, points: np.ndarray, directions: np.ndarray, sigma: np.ndarray, voxel: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points (n, 3) [m, sensor frame] a view agrees with, which it contradicts, and which it looked toward.

    Their directions (n, 3) are turned as the view's, and their standard deviations (n,) [m].
    """
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    # the nine cells reach half again a cell's width to every side
    reach = 1.5 * np.sqrt(4 * np.pi) / len(view.levels[0]) * ranges
    doublings = np.ceil(np.log2(np.maximum(_SIGMAS * sigma, 1e-12) / np.maximum(reach, 1e-12)))
    nearest = np.full(len(points), np.nan)  # it stays so where the direction is not sure enough for any level
    for fineness, image in enumerate(view.levels):
        chosen = np.flatnonzero(np.maximum(doublings, 0) == fineness)
        nearest[chosen] = image.ravel()[octahedral_cells(directions[chosen], len(image))]
    tolerance = _tolerance(ranges, sigma, voxel)
    return np.abs(ranges - nearest) <= tolerance, ranges + tolerance < nearest, ~np.isnan(nearest)


def _tolerance(ranges: np.ndarray, sigma: np.ndarray, voxel: float) -> np.ndarray:
    """How far a point may be before or behind a surface and still be taken for it (n,) [m]."""
    return _REACH * voxel + _SLOPE * ranges + _SIGMAS * sigma
