"""The voxel grid that a set of scans shares, and the center of each scan on it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import EDGES, neighbors
from sonarmap.spectral.scan import Scan

_TRIM = 0.01  # share of points, as stray echoes, that a scan's box leaves out at both ends of each axis
_FINEST_COARSE = 64  # largest edge of the coarse grid [voxels]
_FINE = 128  # smallest edge whose pairs are retried on half of it, where noise hides less [voxels]
_FARTHEST = 1e6  # largest coordinate [voxels]
_MARGIN = 1.2  # grid over box of the largest scan; a cyclic shift is ambiguous without a margin


@dataclass(frozen=True, slots=True)
class Grid:
    """A cube of voxels, the same for every scan of a survey.

    Attributes:
        edge: voxels per edge, an even product of 2, 3 and 5 from 16 to 512 (`kernels.fft.edges.EDGES`).
        voxel: edge of a voxel [m].
    """

    edge: int
    voxel: float

    def __post_init__(self) -> None:
        _require_edge(self.edge)
        if not isinstance(self.voxel, Real) or not 0 < self.voxel < math.inf:
            raise InputError(f"`voxel={self.voxel}` is not a length in meters above zero; try `voxel=0.5`")

    @property
    def extent(self) -> float:
        return self.edge * self.voxel

    def to_voxels(self, points: np.ndarray, center: np.ndarray) -> np.ndarray:
        """Points (N, 3) [m] about `center` (3,) [m], in voxels relative to the grid's center, float32.

        Coordinates are clipped to a million voxels, far outside any grid.
        """
        voxels = np.subtract(points, center, dtype=np.float64)
        voxels /= self.voxel
        return np.clip(voxels, -_FARTHEST, _FARTHEST, out=voxels).astype(np.float32)


def coarse_edge(edge: int) -> int:
    """Voxels per edge of the coarse grid of the same extent: the allowed number nearest to half, in ratio, and at most
    64."""
    return min(_FINEST_COARSE, _half(edge))


def second_edge(edge: int) -> int | None:
    """Voxels per edge of the grid of the same extent for the coarse-grid retry; None if the grid is not fine."""
    return _half(edge) if edge >= _FINE else None


def image_edge(edge: int) -> int:
    """Pixels per edge of the magnitude spectrum's unwraps: the smallest allowed multiple of 16 not below `edge`."""
    return next(allowed for allowed in EDGES if allowed >= edge and allowed % 16 == 0)


def scan_center(scan: Scan) -> np.ndarray:
    """Center (3,) [m, sensor frame] of the scan's trimmed bounding box, used as the grid's center so that a scan far
    from its sensor fills the grid too."""
    low, high = trimmed_box(scan)
    return (low + high) / 2


def choose_grid(scans: Iterable[Scan], edge: int = 128, voxel: float | None = None) -> Grid:
    """The grid for a set of scans: with the given voxel, or one with which the largest scan fits with a margin.

    Args:
        scans: the scans that share the grid.
        edge: voxels per edge, an even product of 2, 3 and 5 from 16 to 512.
        voxel: edge of a voxel [m]; None to choose it.

    Raises:
        InputError: without a voxel, if no scan has an extent (all points of each in one place) or one is no Scan.
    """
    if voxel is None:
        if not np.iterable(scans):
            raise InputError(f"`scans` are {scans!r}; wanted a list of Scan")
        voxel = voxel_for(max((scan_extent(scan) for scan in scans), default=0.0), edge)
    return Grid(edge, voxel)


def voxel_for(extent: float, edge: int) -> float:
    """The voxel [m] with which a scan of this extent [m] fits into the grid with a margin."""
    _require_edge(edge)
    if extent <= 0:
        raise InputError(
            "the voxel cannot be chosen: all points of each scan lie in one place. Give scans that show some "
            "structure, or a `voxel` in meters."
        )
    return _MARGIN * extent / edge


def scan_extent(scan: Scan) -> float:
    """Longest edge of the scan's trimmed bounding box [m]; InputError if it is no Scan."""
    if not isinstance(scan, Scan):
        raise InputError(f"`scans` contain {scan!r}; wanted a list of Scan")
    low, high = trimmed_box(scan)
    return float(np.max(high - low))


def trimmed_box(scan: Scan) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (3,) [m, sensor frame] of the scan's points without the outermost 1 % of each axis."""
    low, high = np.quantile(scan.points, [_TRIM, 1 - _TRIM], axis=0).astype(np.float64)
    return low, high


def _half(edge: int) -> int:
    return min(EDGES, key=lambda allowed: abs(np.log(2 * allowed / edge)))


def _require_edge(edge: int) -> None:
    if not isinstance(edge, Integral) or edge not in EDGES:
        below, above = neighbors(edge) if isinstance(edge, Real) else (64, 128)
        raise InputError(
            f"`edge={edge}` is not an even product of 2, 3 and 5 from {EDGES[0]} to {EDGES[-1]}; "
            f"try `edge={below}` or `edge={above}`"
        )
