# pyright: strict
"""The grid of a survey, which does not change with every scan that is added to it."""

from collections.abc import Iterable
from contextlib import suppress
from math import ceil, log2

import numpy as np

from kernels.errors import InputError
from spectral.grid import Grid, choose_grid
from spectral.scan import Scan

# Voxels are one of so many sizes between one and twice as much.
_SIZES = 8
# Of this many scans on, one that is so much larger than nine of ten others is stray echoes, and decides nothing.
_MANY, _USUAL, _STRAY = 10, 0.9, 1.5


def survey_grid(scans: Iterable[Scan], edge: int = 128, voxel: float | None = None) -> Grid:
    """The grid that all scans of a survey share: the voxel as given, or one that suits the largest scan.

    A chosen voxel is rounded up to a power of 2^(1/8) m, 9 % apart, so that pairs that were registered can be used
    again when scans are added; and a scan of stray echoes does not make it coarse for all others.

    Args:
        scans: of the survey, or of several of one place.
        edge: voxels per edge, a power of two from 16 to 512.
        voxel: edge of a voxel [m]; None to choose it.

    Raises:
        InputError: a voxel is not given and no scan has an extent.
    """
    scans = list(scans)
    if voxel is not None:
        return Grid(edge, voxel)
    sizes: list[float] = []
    for scan in scans:
        with suppress(InputError):  # all of its points are in one place
            sizes.append(choose_grid([scan], edge).voxel)
    if not sizes:
        return choose_grid(scans, edge)  # says why there is none
    largest = max(sizes)
    if len(sizes) >= _MANY:
        usual = float(np.quantile(sizes, _USUAL))
        largest = max(size for size in sizes if size <= _STRAY * usual)
    return Grid(edge, 2 ** (ceil(_SIZES * log2(largest)) / _SIZES))
