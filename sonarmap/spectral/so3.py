"""Rotations between two scans by correlation over all of SO(3), with spherical harmonics of the layers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import Pending, Readback
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.so3.correlation import LocalMaxima, RotationCorrelation
from sonarmap.kernels.so3.harmonics import Harmonics, equalizers

_BANDWIDTH = 48  # harmonic degrees are below it: the finest detail is 180 / 48 degrees. docs/measured has others
_LAYERS = (0.2, 0.8)  # radii, as shares of N/2 (Sect. 2.8)
_COUNT = 20  # number of layers
ALL = slice(None)
# Bands of layers that are searched separately, as one may find a rotation that another misses: all but the outermost,
# which are the noisiest; the outer half; and the inner quarter, which is coarse but robust.
BANDS = (slice(14), slice(10, 20), slice(5))
# First layer and number of layers of each part when all layers and the bands are stored one after the other.
_COUNTS = [len(range(_COUNT)[layers]) for layers in (ALL, *BANDS)]
PARTS = tuple((sum(_COUNTS[:part]), count) for part, count in enumerate(_COUNTS))
_EQUALIZED = 0.4  # strength of whitening, from plain correlation, 0, to phase only, 1
_SEPARATION = float(np.deg2rad(7.0))  # rotations closer than this are the same [rad]
_EXAMINED = 600  # largest number of peaks to examine: there are ridges where two angles act as their sum
_AT_ONCE = 64  # peaks examined at a time
_SQUARES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _paraboloid() -> np.ndarray:
    """Matrix (10, 27) that maps the values of a voxel and its neighbors, in C order, to the least-squares paraboloid:
    its constant, slopes and quadratic coefficients."""
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.linalg.pinv(np.column_stack([np.ones(27), steps, *(steps[:, a] * steps[:, b] for a, b in _SQUARES)]))


_PARABOLOID = _paraboloid()


@dataclass(frozen=True, slots=True)
class SphereLayers:
    """Spherical harmonics of a scan's layers, each of mean 0 and variance 1."""

    # device (degrees, layers of all PARTS, orders) complex64, the layers of each part equalized and of norm 1 together
    coefficients: Array
    products: np.ndarray  # (degrees, layers, layers) float32, of the unequalized layers, from `Harmonics.products`


@dataclass(frozen=True, slots=True)
class RotationPeaks:
    """Candidate rotations R_target_source (n,), best first, and their scores (n,) float64: correlation as a share of
    that of two equal scans."""

    R: Rotation
    scores: np.ndarray


@dataclass(frozen=True, slots=True)
class Sweep:
    """Rotations to search: turns about an axis, each with several tilts."""

    R: Rotation  # ordered by turn
    tilts: int  # number of rotations of each turn
    apart: float  # minimum difference of the selected rotations [rad]


def distinct_rotations(found: Sequence[RotationPeaks]) -> RotationPeaks:
    """All rotations in order, without those near an earlier one."""
    R = Rotation.concatenate([peaks.R for peaks in found])
    scores = np.concatenate([peaks.scores for peaks in found])
    if not len(scores):
        return RotationPeaks(R, scores)
    kept = distinct(R, np.arange(len(scores)), len(scores))
    return RotationPeaks(R[kept], scores[kept])


class So3:
    """The rotations under which two magnitude spectra agree best, on one device and grid."""

    def __init__(self, device: Device, edge: int, max_tilt: float) -> None:
        """Plan the transforms for volumes of `edge` voxels, with roll and pitch up to max_tilt [rad]."""
        self.device = device
        latitudes, longitudes = max(2 * _BANDWIDTH, -(-3 * edge // 64) * 16), max(256, 2 * edge)
        self._harmonics = Harmonics(device, _BANDWIDTH, latitudes, longitudes)
        self._radii = np.linspace(_LAYERS[0] * edge / 2, min(_LAYERS[1] * edge / 2, edge / 2 - 1.01), _COUNT)
        # angle of the z axis with roll and pitch both at the bound; beyond a right angle that of one alone
        farthest = np.arccos(np.cos(max_tilt) ** 2) if max_tilt < np.pi / 2 else max_tilt
        self._correlation = RotationCorrelation(device, _BANDWIDTH, farthest)

    def analyze(self, magnitude: Array) -> Pending[SphereLayers]:
        """Queue a scan's layers, from its magnitude spectrum (edge, edge, edge/2 + 1). Reading them raises InputError
        if the spectrum is not finite."""
        # all layers have the same weight (Sect. 2.8)
        coefficients = self._harmonics.analyze(magnitude, self._radii)
        queued = Readback(self.device, self._harmonics.products(coefficients))
        return Pending(lambda: self._equalize(coefficients, queued))

    def _equalize(self, coefficients: Array, queued: Readback) -> SphereLayers:
        """The equalized layers of a scan; waits for the device."""
        products = queued.read()
        mixtures = np.zeros((len(products), sum(count for _, count in PARTS), _COUNT), np.float32)
        for (first, count), layers in zip(PARTS, (ALL, *BANDS), strict=True):
            among = products[:, layers, layers]
            energy = np.trace(among[1:], axis1=1, axis2=2).sum()
            mixtures[:, first : first + count, layers] = equalizers(among, _EQUALIZED) / np.sqrt(max(energy, 1e-30))
        return SphereLayers(self._harmonics.mix(coefficients, mixtures), products)

    def correlate(self, target: Array, source: Array) -> Array:
        """Correlation of all layers over all rotations: an image for each second Euler angle, and one of zeros."""
        return self._correlation.correlate(target, source, PARTS[:1])[0]

    def candidates(
        self,
        target: Array,
        source: Array,
        count: int,
        allowed: Callable[[Rotation], np.ndarray],
        parts: Sequence[tuple[int, int]] = PARTS[1:],
    ) -> list[RotationPeaks]:
        """The `count` highest distinct rotations by each part, the bands by default; fewer if fewer are allowed.

        Args:
            target, source: `SphereLayers.coefficients`.
            allowed: returns (n,) bool, which of n rotations are possible.
            parts: any of PARTS.
        """
        correlation = self._correlation.correlate(target, source, parts)
        return [self._best_distinct(peaks, count, allowed) for peaks in self._correlation.peaks(correlation)]

    def _best_distinct(
        self, peaks: LocalMaxima, count: int, allowed: Callable[[Rotation], np.ndarray]
    ) -> RotationPeaks:
        """The highest distinct peaks that are allowed, both at the sample and after interpolation."""
        R, scores, examined = self._correlation.rotations(np.empty((0, 3))), np.empty(0), 0
        kept = np.empty(0, dtype=np.int64)
        for begin in range(0, len(peaks.index), _AT_ONCE):
            index, around = (each[begin : begin + _AT_ONCE] for each in (peaks.index, peaks.around))
            possible = np.flatnonzero(allowed(self._correlation.rotations(index)))[: _EXAMINED - examined]
            examined += len(possible)
            refined = self._correlation.rotations(_refined(index[possible], around[possible]))
            possible = possible[still := allowed(refined)]
            R = Rotation.concatenate([R, refined[still]])
            scores = np.append(scores, around[possible, 13])
            kept = distinct(R, np.arange(len(scores)), count)
            if len(kept) == count or examined == _EXAMINED:
                break
        return RotationPeaks(R[kept], scores[kept]) if len(kept) else RotationPeaks(R, scores)

    def best_of(self, target: Array, source: Array, sweep: Sweep, count: int) -> RotationPeaks:
        """The `count` best turns of a sweep that are far enough apart, best first, each at its best tilt. They need not
        be peaks: with an error of the tilt, or little overlap, the true turn may be on a slope."""
        R, tilts = sweep.R, sweep.tilts
        correlation = self.correlate(target, source).get()[: len(self._correlation.betas)]
        around = np.pad(correlation, ((0, 0), (0, 1), (0, 1)), mode="wrap")
        values = map_coordinates(around, self._correlation.places(R).T, order=1, mode="nearest").reshape(-1, tilts)
        best = np.arange(len(values)) * tilts + values.argmax(axis=1)
        order = np.argsort(-values.max(axis=1), kind="stable")
        kept = best[distinct(R[best], order, count, sweep.apart)]
        return RotationPeaks(R[kept], values.ravel()[kept].astype(np.float64))


def _refined(index: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Peaks (n, 3) interpolated between samples: the top of a paraboloid fitted to the (n, 27) values around. Parabolas
    along each axis would fail at small second angles, where the other two angles act as their sum."""
    fit = around.astype(np.float64) @ _PARABOLOID.T
    hessian = np.empty((len(index), 3, 3))
    for n, (a, b) in enumerate(_SQUARES):
        hessian[:, a, b] = hessian[:, b, a] = fit[:, 4 + n] * (2 if a == b else 1)
    steepest = np.linalg.eigvalsh(hessian)[:, 0]
    # a ridge has no top along it: do not move along it
    bounded = hessian + np.minimum(steepest, -1e-30)[:, None, None] * 1e-2 * np.eye(3)
    offset = -np.linalg.solve(bounded, fit[:, 1:4, None])[..., 0]
    return index + np.where(np.isfinite(offset), np.clip(offset, -1, 1), 0.0)


def distinct(
    R: Rotation,
    order: np.ndarray,
    count: int,
    apart: float = _SEPARATION,
    shifts: np.ndarray | None = None,
    near: float = 0.0,
) -> np.ndarray:
    """Indices of the first `count` rotations, in the given order, farther than `apart` [rad] from earlier ones; or, if
    there are shifts (n, 3), with a shift farther than `near` from theirs."""
    quaternions, nearest = R.as_quat()[order], np.cos(apart / 2)
    free, kept = np.ones(len(order), bool), list[int]()
    while len(kept) < count and free.any():
        n = int(free.argmax())
        same = np.abs(quaternions @ quaternions[n]) >= nearest
        if shifts is not None:
            same &= np.linalg.norm(shifts[order] - shifts[order[n]], axis=1) <= near
        free &= ~same
        free[n] = False
        kept.append(n)
    return order[kept]
