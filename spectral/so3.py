"""Rotations between two scans from all of SO(3) at once: spherical harmonics of the layers, correlated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from kernels.device.device import Array, Device
from kernels.pomf.peak import segment_peaks
from kernels.resample.sphere import sample, upload_directions
from kernels.so3.correlation import RotationCorrelation
from kernels.so3.harmonics import Harmonics, equalize

# Degrees below this; its finest detail is 180 / 48 degrees. docs/registration.md has the figures of others.
_BANDWIDTH = 48
# Sect. 2.8: radii of the layers, as shares of N/2; more layers than these did not do better.
_LAYERS, _COUNT = (0.2, 0.8), 20
ALL = slice(None)
# Layers that name rotations by themselves: all but the outermost, which noise disturbs most; the outer half; and the
# inner quarter, which say little and say it of the most disturbed scans too. What one band misses another may name.
BANDS = (slice(14), slice(10, 20), slice(5))
# How far the filter goes from plain correlation, 0, to phase only, 1.
_EQUALIZED = 0.4
# Two rotations nearer than this are the same [rad].
_SEPARATION = float(np.deg2rad(7.0))
# The distinct ones are chosen among so many peaks: where only the sum of two angles matters there is a ridge of them.
_EXAMINED = 600


@dataclass(frozen=True, slots=True)
class RotationPeaks:
    """Rotations that the spectra allow, best first.

    Attributes:
        R: (n,) R_target_source.
        scores: (n,) float64, the correlation as a share of what two equal scans would have.
    """

    R: Rotation
    scores: np.ndarray


@dataclass(frozen=True, slots=True)
class Sweep:
    """Rotations to choose from: turns about an axis, each with several tilts.

    Attributes:
        R: turn by turn.
        tilts: how many have the same turn.
        apart: those chosen are farther apart than this [rad].
    """

    R: Rotation
    tilts: int
    apart: float


def distinct_rotations(found: Sequence[RotationPeaks]) -> RotationPeaks:
    """Those of all, one after the other, without those near one before them."""
    R = Rotation.concatenate([peaks.R for peaks in found])
    scores = np.concatenate([peaks.scores for peaks in found])
    if not len(scores):
        return RotationPeaks(R, scores)
    kept = _distinct(R, np.arange(len(scores)), len(scores))
    return RotationPeaks(R[kept], scores[kept])  # pyright: ignore[reportArgumentType]


class So3:
    """The rotations under which two magnitude spectra are most alike, on one device and grid."""

    def __init__(self, device: Device, edge: int, max_tilt: float) -> None:
        """Plan the transforms for volumes of `edge` voxels, rolls and pitches up to max_tilt [rad]."""
        self.device = device
        latitudes, longitudes = max(2 * _BANDWIDTH, 3 * edge // 4), max(256, 2 * edge)
        self._harmonics = Harmonics(_BANDWIDTH, latitudes, longitudes)
        self._directions = upload_directions(device, self._harmonics.directions)
        self._radii = np.linspace(_LAYERS[0] * edge / 2, min(_LAYERS[1] * edge / 2, edge / 2 - 1.01), _COUNT)
        # roll and pitch both at the bound carry the z axis this far; beyond a right angle one alone does
        farthest = np.arccos(np.cos(max_tilt) ** 2) if max_tilt < np.pi / 2 else max_tilt
        self._correlation = RotationCorrelation(device, _BANDWIDTH, farthest)

    def analyze(self, magnitude: Array) -> np.ndarray:
        """The coefficients of a scan's layers, each of mean 0 and variance 1, complex64 (degrees, layers, orders).

        Args:
            magnitude: (edge, edge, edge/2 + 1), as `spectrum.magnitude` gives it.
        """
        layers = sample(self.device, magnitude, self._directions, self._radii).get()
        # each layer counts alike (Sect. 2.8)
        return self._harmonics.analyze(self._harmonics.standardize(layers))

    def prepare(self, coefficients: np.ndarray, layers: slice = ALL) -> np.ndarray:
        """The coefficients of `analyze` equalized, whose norm is 1, complex64 (degrees, layers, orders).

        Args:
            layers: those that take part.
        """
        equalized = equalize(coefficients[:, layers], _EQUALIZED)
        return equalized / np.float32(max(np.linalg.norm(equalized), 1e-30))

    def correlate(self, target: np.ndarray, source: np.ndarray) -> Array:
        """The correlation over all rotations, as `RotationCorrelation.correlate` has it."""
        return self._correlation.correlate(target, source)

    def candidates(
        self, target: np.ndarray, source: np.ndarray, count: int, allowed: Callable[[Rotation], np.ndarray]
    ) -> RotationPeaks:
        """The `count` highest distinct rotations that are allowed; fewer where there are no more.

        Args:
            target, source: from `prepare`.
            allowed: which (n,) bool of n rotations are possible.
        """
        correlation = self.correlate(target, source)
        index, _ = segment_peaks(self.device, correlation)
        index = index[index[:, 0] < len(self._correlation.betas)]
        R = self._correlation.rotations(index)
        index = index[allowed(R)][:_EXAMINED]
        if not len(index):
            return RotationPeaks(R[:0], np.empty(0))
        index, values = _refined(correlation.get(), index)
        R = self._correlation.rotations(index)
        kept = _distinct(R, np.flatnonzero(allowed(R)), count)
        return RotationPeaks(R[kept], values[kept])  # pyright: ignore[reportArgumentType]

    def best_of(self, target: np.ndarray, source: np.ndarray, sweep: Sweep, count: int) -> RotationPeaks:
        """The `count` best turns of a sweep that are far enough apart, best first, each at its best tilt.

        Not its peaks alone: where the tilt is off, or the scans share little, the true turn may be on a slope.

        Args:
            target, source: from `prepare`.
        """
        R, each = sweep.R, sweep.tilts
        correlation = self.correlate(target, source).get()[: len(self._correlation.betas)]
        around = np.pad(correlation, ((0, 0), (0, 1), (0, 1)), mode="wrap")
        values = map_coordinates(around, self._correlation.places(R).T, order=1, mode="nearest").reshape(-1, each)
        best = np.arange(len(values)) * each + values.argmax(axis=1)
        order = np.argsort(-values.max(axis=1), kind="stable")
        kept = best[_distinct(R[best], order, count, sweep.apart)]  # pyright: ignore[reportArgumentType]
        return RotationPeaks(R[kept], values.ravel()[kept].astype(np.float64))  # pyright: ignore[reportArgumentType]


def _refined(correlation: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Peaks (n, 3) between the samples, and their values: the top of the paraboloid through the 27 values around.

    At a small second angle the others act as one, their sum: a parabola along each axis by itself would miss that.
    """
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    around = (index[:, None, :] + steps) % correlation.shape
    # beyond the first and last second angle the correlation is not periodic: the row itself again
    around[..., 0] = np.clip(index[:, None, 0] + steps[:, 0], 0, correlation.shape[0] - 2)
    values = correlation[around[..., 0], around[..., 1], around[..., 2]].astype(np.float64)
    squares = [steps[:, a] * steps[:, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    design = np.column_stack([np.ones(27), steps, *squares])
    fit = values @ np.linalg.pinv(design).T
    hessian = np.empty((len(index), 3, 3))
    for n, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        hessian[:, a, b] = hessian[:, b, a] = fit[:, 4 + n] * (2 if a == b else 1)
    steepest = np.linalg.eigvalsh(hessian)[:, 0]
    # a ridge has no top along it: there the place stays
    bounded = hessian + np.minimum(steepest, -1e-30)[:, None, None] * 1e-2 * np.eye(3)
    offset = -np.linalg.solve(bounded, fit[:, 1:4, None])[..., 0]
    offset = np.where(np.isfinite(offset), np.clip(offset, -1, 1), 0.0)
    return index + offset, values[:, 13]


def _distinct(R: Rotation, order: np.ndarray, count: int, apart: float = _SEPARATION) -> np.ndarray:
    """The first `count` of the given rotations, none within `apart` [rad] of one before it."""
    quaternions = R.as_quat()
    nearest = np.cos(apart / 2)
    kept: list[int] = []
    for n in order:
        if not kept or np.abs(quaternions[kept] @ quaternions[n]).max() < nearest:
            kept.append(int(n))
        if len(kept) == count:
            break
    return np.array(kept, dtype=np.int64)
