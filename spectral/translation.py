"""The shift between two scans once the rotation is known: Sect. 2.10 of the paper."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.device.device import Array, Device
from kernels.points.voxelize import voxelize
from kernels.pomf.peak import Peak, find_peaks, peak_at
from kernels.pomf.spectrum import Pomf, whiten

# Standard deviation of the Gaussian that the correlation is convolved with [voxels]. Noise of the scans and the
# voxels' edges spread the peak over its neighbors; without the blur the highest voxel is often a wrong one.
BLUR = 0.7
# Shifts that are no farther apart than this are the same answer [voxels].
SAME_SHIFT = 6.0


class Volume(Protocol):
    """What of a scan is needed: `Prepared` has it, and so has a scan on a coarser grid."""

    @property
    def points(self) -> Array:
        """Device (n, 4) float32 [voxels from the grid's center; weight]."""
        ...

    @property
    def spectra(self) -> tuple[Array, ...]:
        """Device (N, N, N/2 + 8) complex64 each, the spectrum of the volume whitened with each exponent."""
        ...


@dataclass(frozen=True, slots=True)
class Box:
    """Shifts that are possible.

    Attributes:
        center: (3,) whole numbers [voxels].
        half: (3,) the largest distance from it along each axis [voxels].
    """

    center: np.ndarray
    half: np.ndarray


class Translation:
    """POMF of the target with the source turned into the target's orientation, on one device and grid."""

    def __init__(self, device: Device, edge: int, exponents: tuple[float, ...] = (1.0,)) -> None:
        """Plan the volume and its transforms; the volumes to correlate are whitened with the same exponents."""
        self.device, self.edge, self.exponents = device, edge, exponents
        cube, half = (edge, edge, edge), (edge, edge, edge // 2 + 8)
        self._pomf = Pomf(device, cube, BLUR)
        self._volume = device.empty(cube)
        self._spectrum = device.empty(half, np.complex64)
        self._whitened = device.empty(half, np.complex64) if len(exponents) > 1 else self._spectrum
        self._correlation = device.empty(cube)

    def correlate(self, target: Volume, source: Volume, R_target_source: Rotation) -> Array:
        """The correlation with the first exponent (N, N, N) float32; the array is used again by the next call."""
        return next(self.correlations(target, source, R_target_source))

    def correlations(
        self, target: Volume, source: Volume, R_target_source: Rotation, offset: np.ndarray | None = None
    ) -> Iterator[Array]:
        """For each exponent the correlation (N, N, N) float32; the array is used again by the next.

        A peak at s means p_target = R p_source + s about the grid centers. The points are turned and put into voxels
        anew: turning the voxel data would blur them.

        Args:
            offset: (3,) [voxels] by which the source is moved before; peaks are at s - offset then.
        """
        R = R_target_source.as_matrix()
        voxelize(self.device, source.points, self.edge, R=R, offset=offset, out=self._volume)
        spectrum = self._pomf.transform(self._volume, out=self._spectrum)
        for exponent, target_spectrum in zip(self.exponents, target.spectra, strict=True):
            whitened = whiten(self.device, spectrum, exponent, out=self._whitened)
            yield self._pomf.correlate(target_spectrum, whitened, out=self._correlation)

    def find(self, target: Volume, source: Volume, R_target_source: Rotation) -> Peak:
        """The highest peak of the correlation."""
        return find_peaks(self.device, self.correlate(target, source, R_target_source))[0]

    def find_within(
        self, target: Volume, source: Volume, R_target_source: Rotation, box: Box | None, count: int, separation: float
    ) -> list[list[Peak]]:
        """For each exponent the `count` highest peaks within a box, or all that are, farther than `separation` apart.

        Within a box a peak's shift is what it names; elsewhere it is one of what is cyclic. What the box moves out
        of the grid takes no part.
        """
        if box is None or not self.is_bounded(box):
            found = self.correlations(target, source, R_target_source)
            return [find_peaks(self.device, each, count=count, separation=separation) for each in found]
        limits = float(box.half[0]), float(box.half[1]), float(box.half[2])
        found = self.correlations(target, source, R_target_source, box.center)
        peaks = (find_peaks(self.device, each, count=count, separation=separation, limits=limits) for each in found)
        return [[replace(peak, shift=peak.shift + box.center) for peak in each] for each in peaks]

    def is_bounded(self, box: Box | None) -> bool:
        """Whether a box is smaller than the grid."""
        return box is not None and bool((box.half < self.edge / 2).all())

    def find_at(self, target: Volume, source: Volume, R_target_source: Rotation, shift: np.ndarray) -> Peak:
        """The highest place within a voxel of a shift (3,) [voxels], be it a peak or on the slope of another."""
        correlation = self.correlate(target, source, R_target_source)
        return peak_at(self.device, correlation, np.rint(shift).astype(np.int64))

    def find_others(self, target: Volume, source: Volume, R_target_source: Rotation, separation: float) -> list[Peak]:
        """The next highest peak of the correlation, farther than `separation` [voxels] from the highest, if any."""
        correlation = self.correlate(target, source, R_target_source)
        return find_peaks(self.device, correlation, count=2, separation=separation)[1:]
