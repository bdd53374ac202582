"""Where two surfaces of little relief lie on each other: their heights over one plane, compared at every shift.

Where beams lie farther apart than voxels, the lines that they draw on a bed correlate best where nothing has moved. In
heights no such line is left: they are compared in the cells that both scans show, by the masked normalized
cross-correlation of Padfield (2012, DOI 10.1109/TIP.2011.2181402).
"""

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter

_CELL = 4.0  # edge of a cell, about as far as beams lie apart [voxels]
# A point farther from the usual height than so many times what points usually are, and than so much, is none of the bed
# [voxels].
_OUTLYING, _NEAR = 6.0, 2.0
# Fewer cells in common than this share of what the smaller surface shows say nothing, nor do heights less alike.
_SHARED, _ALIKE = 0.25, 0.3


def alike_places(
    target: np.ndarray, source: np.ndarray, plane: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The shifts of the source after which heights over a plane are most alike.

    Args:
        target: (n, 3) points.
        source: (m, 3) points, in the same axes and unit [voxels].
        plane: (3, 2) the plane's directions, orthonormal, in columns.
        count: of shifts, at most.

    Returns:
        (k, 3) shifts, along the plane to a cell, and so that the heights in common are equally high [voxels]; and (k,)
        how alike the heights are there, 0..1, highest first. None where a scan has no points.
    """
    if not (len(target) and len(source)):
        return np.zeros((0, 3)), np.zeros(0)
    axes = np.column_stack([plane, np.cross(plane[:, 0], plane[:, 1])])
    ours, theirs = _Heights(target @ axes), _Heights(source @ axes)
    shape = _next_fast(ours.shape[0] + theirs.shape[0]), _next_fast(ours.shape[1] + theirs.shape[1])
    a, b = ours.spectra(shape), [np.conj(spectrum) for spectrum in theirs.spectra(shape)]

    def together(i: int, j: int) -> np.ndarray:
        """By shift, the sum over the cells in common of powers of our heights times powers of theirs."""
        return np.asarray(fft.irfft2(a[i] * b[j], shape))

    cells = np.maximum(together(0, 0), 1e-9)
    mean, other = together(1, 0) / cells, together(0, 1) / cells
    squares = (together(2, 0) / cells - mean**2) * (together(0, 2) / cells - other**2)
    alike = (together(1, 1) / cells - mean * other) / np.sqrt(np.maximum(squares, 1e-9))
    alike[cells < _SHARED * min(ours.count, theirs.count)] = -1.0
    peaks = np.argwhere((maximum_filter(alike, 3, mode="wrap") == alike) & (alike > _ALIKE))
    peaks = peaks[np.argsort(-alike[tuple(peaks.T)], kind="stable")][:count]
    at = tuple(peaks.T)
    # a correlation is cyclic: where the source starts before the target, the shift is below 0
    steps = np.where(peaks >= np.array(ours.shape), peaks - np.array(shape), peaks)
    shifts = _CELL * (steps + ours.first - theirs.first)
    return np.column_stack([shifts, (mean - other)[at] + ours.usual - theirs.usual]) @ axes.T, alike[at]


def _next_fast(length: int) -> int:
    """A length, not below this, whose transform is fast."""
    return int(fft.next_fast_len(length, real=True) or length)


class _Heights:
    """The mean height of a surface in each cell of a plane."""

    def __init__(self, points: np.ndarray) -> None:
        """Of points (n, 3) whose third coordinate is the height."""
        self.usual = float(np.median(points[:, 2]))
        off = points[:, 2] - self.usual
        bed = np.abs(off) <= max(_OUTLYING * float(np.median(np.abs(off))), _NEAR)
        cell = np.floor(points[bed, :2] / _CELL).astype(np.int64)
        self.first = cell.min(axis=0)
        self.shape: tuple[int, ...] = tuple((cell.max(axis=0) - self.first + 1).tolist())
        index, size = np.ravel_multi_index(tuple((cell - self.first).T), self.shape), int(np.prod(self.shape))
        filled = np.bincount(index, minlength=size)
        self._heights = np.bincount(index, off[bed], size) / np.maximum(filled, 1)
        self._shown = (filled > 0).astype(np.float64)
        self.count = int(self._shown.sum())

    def spectra(self, shape: tuple[int, ...]) -> list[np.ndarray]:
        """Of which cells are shown, of their heights and of these squared."""
        planes = (self._shown, self._heights, self._heights**2)
        return [np.asarray(fft.rfft2(plane.reshape(self.shape), shape)) for plane in planes]
