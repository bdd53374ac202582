"""The grid of a survey, which does not change with every scan that is added to it."""

from collections.abc import Iterable
from math import ceil, log2

import numpy as np

from sonarmap.spectral.grid import Grid, scan_extent, voxel_for
from sonarmap.spectral.scan import Scan

_SIZES = 8  # voxel sizes per factor of two
# The few of ten or more scans that need voxels this many times those of the usual scan contain stray echoes. Of fewer
# scans the largest counts itself in the interpolated quantile.
_USUAL_QUANTILE = 0.9
_STRAY_RATIO = 1.5


def survey_grid(scans: Iterable[Scan], edge: int = 128, voxel: float | None = None) -> Grid:
    """The grid that all scans of a survey share: the voxel as given, or one that suits the largest scan.

    A chosen voxel is rounded up to a power of 2^(1/8) m, 9 % apart, so that pairs that were registered can be used
    again when scans are added; and a scan of stray echoes does not make it coarse for all others.
    """
    if voxel is not None:
        return Grid(edge, voxel)
    return grid_of_extents([scan_extent(scan) for scan in scans], edge)


def grid_of_extents(extents: Iterable[float], edge: int = 128) -> Grid:
    """The grid for scans of these extents [m], which `scan_extent` measures."""
    sizes = [voxel_for(extent, edge) for extent in extents if extent > 0]  # 0: all points are in one place
    largest = max(sizes, default=0.0) or voxel_for(0.0, edge)  # which raises and says why
    if sizes:
        usual = float(np.quantile(sizes, _USUAL_QUANTILE))
        largest = max(size for size in sizes if size <= _STRAY_RATIO * usual)
    return Grid(edge, 2 ** (ceil(_SIZES * log2(largest)) / _SIZES))
