"""The voxel grid that a set of scans shares, and where each scan lies in it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import EDGES, neighbors
from sonarmap.spectral.scan import Scan

_TRIM = 0.01  # share of the points at either end of an axis that a scan's box leaves out, as stray echoes are
_FINEST_COARSE = 64  # most voxels along an edge of the coarse grid
_FINE = 128  # voxels along an edge from which on noise as large as a voxel hides what half as many show
_FARTHEST = 1e6  # [voxels]
_MARGIN = 1.2  # of the largest scan's box, which a periodic shift needs to distinguish left from right


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

        What lies more than a million voxels away is brought to that distance: far outside any grid, too.
        """
        voxels = (points.astype(np.float64) - center) / self.voxel
        return np.clip(voxels, -_FARTHEST, _FARTHEST).astype(np.float32)


def coarse_edge(edge: int) -> int:
    """Voxels per edge of the coarse grid of the same extent: the allowed number nearest to half (in ratio), up to
    64."""
    return min(_FINEST_COARSE, _half(edge))


def second_edge(edge: int) -> int | None:
    """Voxels per edge of the grid of the same extent on which a fine grid's pairs are tried again; None if not fine."""
    return _half(edge) if edge >= _FINE else None


def image_edge(edge: int) -> int:
    """Pixels per edge of the images that the magnitude spectrum is unwrapped to: an allowed multiple of 16."""
    return next(allowed for allowed in EDGES if allowed >= edge and allowed % 16 == 0)


def scan_center(scan: Scan) -> np.ndarray:
    """Center (3,) [m, sensor frame] of the scan's trimmed bounding box, where the grid's center is put: the scan fills
    the grid however far from the sensor it lies."""
    low, high = trimmed_box(scan)
    return (low + high) / 2


def choose_grid(scans: Iterable[Scan], edge: int = 128, voxel: float | None = None) -> Grid:
    """The grid for a set of scans: the voxel as given, or so large that the largest scan fits with a margin.

    Args:
        scans: that share the grid.
        edge: voxels per edge, an even product of 2, 3 and 5 from 16 to 512.
        voxel: edge of a voxel [m]; None to choose it.

    Raises:
        InputError: a voxel is not given and no scan has an extent (all points of each in one place), or one is no Scan.
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
    """The longest edge of the scan's trimmed bounding box [m]; InputError of what is no Scan."""
    if not isinstance(scan, Scan):
        raise InputError(f"`scans` have {scan!r} among them; wanted a list of Scan")
    low, high = trimmed_box(scan)
    return float(np.max(high - low))


def trimmed_box(scan: Scan) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest corner (3,) [m, sensor frame] of the scan's points but for the outermost 1 %."""
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
