"""The correlations as a surveyor reads them: over yaw and the angle between the verticals, and over level shifts."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.tilt import tilt_allowed


@dataclass(frozen=True, slots=True)
class RotationMap:
    """For each yaw and tilt the highest value of the correlation over SO(3)."""

    # (tilts, yaws) float64, a share of what two equal scans would have; NaN where no rotation is allowed
    values: np.ndarray
    tilts: np.ndarray  # (tilts + 1,) edges of the rows [deg]: the angle between the z axes of target and source
    yaws: np.ndarray  # (yaws + 1,) edges of the columns [deg], from -180 to 180; R = Rz(yaw) Ry(pitch) Rx(roll)


def map_rotations(correlation: np.ndarray, bandwidth: int, max_tilt: float) -> RotationMap:
    """The map of a correlation (n + 1, edge, edge) from `RotationCorrelation.correlate`, whose last image is no part
    of it: [b, i, j] is of Rz(alpha) Ry(beta) Rz(gamma), alpha and gamma around the full circle, beta evenly from half
    a step of pi / (2 bandwidth) on. Roll and pitch are allowed up to `max_tilt` [rad].
    """
    count, edge = len(correlation) - 1, correlation.shape[1]
    step, turn = np.pi / (2 * bandwidth), 2 * np.pi / edge
    alpha, gamma = (angle.ravel() * turn for angle in np.meshgrid(*[np.arange(edge)] * 2, indexing="ij"))
    values = np.full((count, edge), -np.inf)
    for row, beta in enumerate((np.arange(count) + 0.5) * step):
        R = Rotation.from_euler("ZYZ", np.column_stack([alpha, np.full(alpha.shape, beta), gamma]))
        allowed = tilt_allowed(R, max_tilt)
        column = np.floor((yaw_of(R)[allowed] + np.pi) / turn).astype(np.int64) % edge
        np.maximum.at(values[row], column, correlation[row].ravel()[allowed])
    values[np.isneginf(values)] = np.nan
    tilts, yaws = np.arange(count + 1) * step, np.arange(edge + 1) * turn - np.pi
    return RotationMap(values, np.rad2deg(tilts), np.rad2deg(yaws))


def yaw_of(R_target_source: Rotation) -> np.ndarray:
    """The yaw of rotations, () or (n,) [rad], -pi..pi: where the source's x axis points on the target's plane."""
    forward = R_target_source.apply([1.0, 0.0, 0.0])
    return np.arctan2(forward[..., 1], forward[..., 0])


def tilt_of(R_target_source: Rotation) -> np.ndarray:
    """The angle between the z axes, () or (n,) [rad], 0..pi."""
    up = R_target_source.apply([0.0, 0.0, 1.0])
    return np.arccos(np.clip(up[..., 2], -1.0, 1.0))


@dataclass(frozen=True, slots=True)
class TranslationSlice:
    """The correlation at the height of the found translation."""

    # (N, N) float32, [i, j] at x index i and y index j: standard deviations above the correlation's mean
    heights: np.ndarray
    # x, y: (N + 1,) edges of the voxels [m]: x and y of T_target_source's translation
    x: np.ndarray
    y: np.ndarray
    z: float  # of the slice [m]
    place: np.ndarray  # (2,) x and y of the peak [m]
    psr: float  # of the peak


def slice_translation(
    correlation: np.ndarray, peak: Peak, shift: np.ndarray, origin: np.ndarray, voxel: float
) -> TranslationSlice:
    """The slice of a cyclic correlation (N, N, N) through the peak that is near the shift (3,) [voxels].

    The shift may be longer than half the grid, which the peak's own is not; `origin` (3,) is the translation that no
    shift at all means [m], `voxel` an edge [m].
    """
    edge = len(correlation)
    # the peak's own shift repeats after the grid's edge: that which is nearest to what was found
    shown = peak.shift + edge * np.rint((shift - peak.shift) / edge)
    rows, edges = zip(*(_window(shown[axis], edge) for axis in (0, 1)), strict=True)
    level = int(peak.index[2])
    heights = correlation[np.ix_(rows[0], rows[1], [level])][..., 0]
    z = level + edge * np.rint((shown[2] - level) / edge)
    return TranslationSlice(
        heights=(heights - peak.mean) / (peak.std if peak.std > 0 else 1.0),
        x=origin[0] + voxel * edges[0],
        y=origin[1] + voxel * edges[1],
        z=float(origin[2] + voxel * z),
        place=origin[:2] + voxel * shown[:2],
        psr=peak.psr,
    )


def _window(shift: float, edge: int) -> tuple[np.ndarray, np.ndarray]:
    """One axis' (edge,) cyclic indices and (edge + 1,) edges [voxels]: all of the grid, so that the shift is in it."""
    start = -edge // 2
    if not start <= shift < start + edge - 1:
        start = int(np.rint(shift)) - edge // 2
    places = start + np.arange(edge + 1)
    return places[:-1] % edge, places - 0.5
