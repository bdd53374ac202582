"""Alignment of two beds of little relief by correlating their heights at all turns and shifts over the bed.

If beams are farther apart than voxels, the lines that they draw on a bed correlate best at the identity, and the
spectra of a bed hardly show its heading. Heights do not contain these lines. The beds' planes leave one turn and two
shifts, which are searched exhaustively by the masked normalized cross-correlation of Padfield (2012, DOI
10.1109/TIP.2011.2181402).
"""

from collections.abc import Callable, Iterable, Iterator
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
    heights = Heights.of(ours.places, ours.places[:, :2].min(axis=0), ours.places[:, :2].max(axis=0))
    tried = np.flatnonzero(allowed(R)).tolist()
    turned = (Heights.of(turns[turn].apply(theirs.places), -reach, reach) for turn in tried)
    found = zip(tried, heights.alike(turned), strict=True)
    rows = np.concatenate([np.zeros((0, 5)), *(np.insert(places[:count], 0, turn, axis=1) for turn, places in found)])
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
    first: np.ndarray  # (2,) int, index of the first cell along both axes
    shown: np.ndarray  # (a, b) 1.0 where there are points, else 0.0
    heights: np.ndarray  # (a, b) [voxels]

    @classmethod
    def of(cls, places: np.ndarray, least: np.ndarray, most: np.ndarray) -> "Heights":
        """Heights, the third coordinate, of points (n, 3), whose others lie between `least` and `most` (2,)."""
        first, last = _cells(least), _cells(most)
        cell, shape = _cells(places[:, :2]) - first, tuple((last - first + 1).tolist())
        index = np.ravel_multi_index(tuple(cell.T), shape, mode="clip")  # the clip allows for rounding of the bounds
        filled = np.bincount(index, minlength=int(np.prod(shape)))
        heights = np.bincount(index, places[:, 2], len(filled)) / np.maximum(filled, 1)
        return cls(first, (filled > 0).astype(np.float64).reshape(shape), heights.reshape(shape))

    def alike(self, sources: Iterable["Heights"]) -> Iterator[np.ndarray]:
        """Matches (k, 4) of each source, best first: shift along both axes [cells], height offset, and similarity. All
        sources have one shape."""
        shape: tuple[int, ...] = ()
        ours = np.empty(0)
        for source in sources:
            if not shape:
                lengths = zip(self.shown.shape, source.shown.shape, strict=True)
                shape = tuple(int(fft.next_fast_len(a + b, real=True)) for a, b in lengths)
                ours = self._spectra(shape)
            yield self._alike(source, ours, shape)

    def _alike(self, source: "Heights", a: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Matches (k, 4) of one source; `a` are the spectra of these heights at that shape."""
        b = np.conj(source._spectra(shape))
        # sums over the cells in common, by shift, of our heights to these powers times theirs to those; in one
        # transform, since calls take longer than the transforms
        ours, theirs = [0, 1, 0, 2, 0, 1], [0, 0, 1, 0, 2, 1]
        cells, *sums = np.asarray(fft.irfft2(a[ours] * b[theirs], shape))
        cells = np.maximum(cells, 1e-9)
        mean, other, square, other_square, both = (each / cells for each in sums)
        squares = (square - mean**2) * (other_square - other**2)
        alike = (both - mean * other) / np.sqrt(np.maximum(squares, 1e-9))
        alike[(cells < _SHARED * min(self.shown.sum(), source.shown.sum())) | (alike < _ALIKE)] = 0.0
        alike = np.arctanh(np.minimum(alike, 0.999)) * np.sqrt(cells)
        peaks = np.argwhere((maximum_filter(alike, 3, mode="wrap") == alike) & (alike > 0))
        peaks = peaks[np.argsort(-alike[tuple(peaks.T)], kind="stable")]
        at = tuple(peaks.T)
        # the correlation is cyclic: peaks past the target's shape are negative shifts
        steps = np.where(peaks >= np.array(self.shown.shape), peaks - np.array(shape), peaks)
        return np.column_stack([steps + self.first - source.first, (mean - other)[at], alike[at]])

    def _spectra(self, shape: tuple[int, ...]) -> np.ndarray:
        """Spectra of the mask of shown cells, of the heights, and of the squared heights."""
        return np.asarray(fft.rfft2(np.stack([self.shown, self.heights, self.heights**2]), shape))


def _cells(places: np.ndarray) -> np.ndarray:
    return np.floor(places / _CELL).astype(np.int64)
