"""A horizontal slice of the translation's correlation, in the meters of the transform that it leads to."""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.pomf.peak import Peak


@dataclass(frozen=True, slots=True)
class TranslationSlice:
    """The correlation at the height of the found translation.

    Attributes:
        heights: (N, N) float32, [i, j] at x index i and y index j: standard deviations above the correlation's mean.
        x, y: (N + 1,) edges of the voxels [m]: x and y of T_target_source's translation.
        z: of the slice [m].
        place: (2,) x and y of the peak [m].
        psr: of the peak.
    """

    heights: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: float
    place: np.ndarray
    psr: float


def slice_translation(
    correlation: np.ndarray, peak: Peak, shift: np.ndarray, origin: np.ndarray, voxel: float
) -> TranslationSlice:
    """The slice through a peak.

    Args:
        correlation: (N, N, N), cyclic.
        peak: of it, near the shift.
        shift: (3,) that was found [voxels]; it may be longer than half the grid, which the peak's own, cyclic, is not.
        origin: (3,) translation that no shift at all means [m].
        voxel: [m].
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
