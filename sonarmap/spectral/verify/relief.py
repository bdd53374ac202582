"""Alignment of two beds of little relief by correlating their heights at all turns and shifts over the bed.

If beams are farther apart than voxels, the lines that they draw on a bed correlate best at the identity, and the
spectra of a bed hardly show its heading. Heights do not contain these lines. The beds' planes leave one turn and two
shifts, which are searched exhaustively by the masked normalized cross-correlation of Padfield (2012, DOI
10.1109/TIP.2011.2181402).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter
from scipy.spatial.transform import Rotation

from sonarmap.spectral.prepare.surface import Surface

_CELL = 4.0  # edge of a cell, about the spacing of beams [voxels]
_TURNS = 45  # number of turns, 8 degrees apart
_LEVEL = 0.8  # minimum mean square of a bed's normals along one direction
# Points farther than both from the median height are outliers.
_OUTLYING = 6.0  # [median absolute deviations]
_NEAR = 2.0  # [voxels]
# Minima for a significant match.
_SHARED = 0.25  # cells in common, as a share of the smaller surface
_ALIKE = 0.2  # correlation of the heights
_SAME = 3  # places of neighboring turns no farther apart along either axis are the same [cells]


@dataclass(frozen=True, slots=True)
class AlikePlaces:
    """Poses of a source, best first: k rotations, (k, 3) shifts [voxels], and (k,) similarities of the heights."""

    R: Rotation
    shifts: np.ndarray
    alike: np.ndarray


def is_level(surface: Surface) -> bool:
    """Whether a surface is a level bed, which constrains the turn about its normal and shifts along it weakly."""
    return surface.usual_normal[1] >= _LEVEL


def alike_places(
    target: Surface, source: Surface, allowed: Callable[[Rotation], np.ndarray], count: int
) -> AlikePlaces:
    """The `allowed` poses of the source, at most `count`, with the highest similarity of both beds' heights over their
    planes.

    Similarity is Fisher's transform of the correlation, times the root of the number of cells in common: the same
    correlation is more significant with more cells.
    """
    ours, theirs = _Bed.of(target), _Bed.of(source)
    if not (target.rays.any() and source.rays.any()) and ours.axes[:, 2] @ theirs.axes[:, 2] < 0:
        theirs = theirs.turned_over()
    turns = Rotation.from_rotvec(np.linspace(0, 2 * np.pi, _TURNS, endpoint=False)[:, None] * [0.0, 0.0, 1.0])
    R = Rotation.from_matrix(ours.axes) * turns * Rotation.from_matrix(theirs.axes).inv()
    reach = np.full(2, np.linalg.norm(theirs.places[:, :2], axis=1).max())
    heights = Heights.of(ours.places[None], ours.places[:, :2].min(axis=0), ours.places[:, :2].max(axis=0))
    tried = np.flatnonzero(allowed(R))
    turned = Heights.of(theirs.places @ turns[tried].as_matrix().transpose(0, 2, 1), -reach, reach)
    rows = heights.alike(turned, count)
    rows[:, 0] = tried[rows[:, 0].astype(np.int64)]
    rows = _distinct(rows[np.argsort(-rows[:, 4], kind="stable")], count)
    R = R[rows[:, 0].astype(np.int64)]
    along = rows[:, 1:4] * [_CELL, _CELL, 1.0] @ ours.axes.T
    return AlikePlaces(R, ours.middle + along - R.apply(theirs.middle), rows[:, 4])


def _distinct(rows: np.ndarray, count: int) -> np.ndarray:
    """Rows (turn, shift, ...), best first, without those near a better one; at most `count`."""
    chosen: list[int] = []
    for k, row in enumerate(rows):
        apart = np.abs(rows[chosen, :3] - row[:3])
        turned = np.minimum(apart[:, 0], _TURNS - apart[:, 0])
        if not ((turned <= 1) & (apart[:, 1:] <= _SAME).all(axis=1)).any():
            chosen.append(k)
        if len(chosen) == count:
            break
    return rows[chosen]


@dataclass(frozen=True, slots=True)
class _Bed:
    axes: np.ndarray  # (3, 3) in columns, right-handed: two along the plane, and its normal
    middle: np.ndarray  # (3,) on the plane [voxels]
    places: np.ndarray  # (n, 3) points relative to the middle, along the axes; the third is the height [voxels]

    @classmethod
    def of(cls, surface: Surface) -> "_Bed":
        up, points = surface.usual_normal[0], surface.points.astype(np.float64)
        off = points @ up - np.median(points @ up)
        bed = points[np.abs(off) <= max(_OUTLYING * float(np.median(np.abs(off))), _NEAR)]
        middle = bed.mean(axis=0)
        normal, _, along = np.linalg.eigh((bed - middle).T @ (bed - middle))[1].T
        normal = normal if normal @ up >= 0 else -normal
        axes = np.column_stack([along, np.cross(normal, along), normal])
        return cls(axes, middle, (bed - middle) @ axes)

    def turned_over(self) -> "_Bed":
        """The bed with its plane's normal reversed."""
        over = np.array([1.0, -1.0, -1.0])
        return _Bed(self.axes * over, self.middle, self.places * over)


@dataclass(frozen=True, slots=True)
class Heights:
    """Heights of t beds, or of one at t turns, on the same cells."""

    first: np.ndarray  # (2,) int, index of the first cell along both axes
    shown: np.ndarray  # (t, a, b) float32, 1 where there are points, else 0
    heights: np.ndarray  # (t, a, b) float32 [voxels]

    @classmethod
    def of(cls, places: np.ndarray, least: np.ndarray, most: np.ndarray) -> "Heights":
        """Heights, the third coordinate, of points (t, n, 3), whose others lie between `least` and `most` (2,)."""
        first, last = _cells(least), _cells(most)
        shape = (len(places), *(last - first + 1).tolist())
        cell = np.moveaxis(_cells(places[..., :2]) - first, -1, 0)
        each = np.broadcast_to(np.arange(len(places))[:, None], cell.shape[1:])
        index = np.ravel_multi_index((each, *cell), shape, mode="clip").ravel()  # for rounding of the bounds
        filled = np.bincount(index, minlength=int(np.prod(shape)))
        heights = np.bincount(index, places[..., 2].ravel(), len(filled)) / np.maximum(filled, 1)
        return cls(first, (filled > 0).astype(np.float32).reshape(shape), heights.astype(np.float32).reshape(shape))

    def alike(self, sources: "Heights", count: int) -> np.ndarray:
        """Matches (k, 5) of one bed with the sources, up to `count` of each, best first: number of the source, shift
        along both axes [cells], height offset, and similarity."""
        shape = tuple(
            int(fft.next_fast_len(a + b, real=True))
            for a, b in zip(self.shown.shape[1:], sources.shown.shape[1:], strict=True)
        )
        ours, theirs = self._spectra(shape), np.conj(sources._spectra(shape))
        # sums over the cells in common, by shift, of our heights to a power times theirs to another
        cells, mean, other, square, other_square, both = (
            fft.irfft2(ours[i] * theirs[j], shape) for i, j in ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
        )
        cells = np.maximum(cells, 1e-9)
        for total in (mean, other, square, other_square, both):
            total /= cells
        squares = (square - mean**2) * (other_square - other**2)
        alike = (both - mean * other) / np.sqrt(np.maximum(squares, 1e-9))
        fewest = _SHARED * np.minimum(self.shown.sum(), sources.shown.sum(axis=(1, 2), keepdims=True))
        alike[(cells < fewest) | (alike < _ALIKE)] = 0.0
        alike = np.arctanh(np.minimum(alike, 0.999)) * np.sqrt(cells)
        peaks = np.argwhere((maximum_filter(alike, (1, 3, 3), mode="wrap") == alike) & (alike > 0))
        peaks = peaks[np.lexsort((-alike[tuple(peaks.T)], peaks[:, 0]))]
        of_source = np.arange(len(peaks)) - np.searchsorted(peaks[:, 0], peaks[:, 0])
        peaks = peaks[of_source < count]
        at = tuple(peaks.T)
        # the correlation is cyclic: peaks past the target's shape are negative shifts
        steps = peaks[:, 1:] - np.where(peaks[:, 1:] >= np.array(self.shown.shape[1:]), np.array(shape), 0)
        return np.column_stack([peaks[:, 0], steps + self.first - sources.first, (mean - other)[at], alike[at]])

    def _spectra(self, shape: tuple[int, ...]) -> np.ndarray:
        """(3, t, ...) spectra of the mask of shown cells, of the heights, and of the squared heights."""
        powers = np.stack([self.shown, self.heights, self.heights**2])
        return np.asarray(fft.rfft2(powers, shape))


def _cells(places: np.ndarray) -> np.ndarray:
    return np.floor(places / _CELL).astype(np.int64)
