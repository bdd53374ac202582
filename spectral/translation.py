"""The shift between two scans once the rotation is known: Sect. 2.10 of the paper."""

from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.device.device import Array, Device
from kernels.points.voxelize import voxelize
from kernels.pomf.peak import Peak, find_peaks, peak_at
from kernels.pomf.spectrum import Pomf

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
    def spectrum(self) -> Array:
        """Device (N, N, N/2 + 8) complex64, whitened spectrum of the volume."""
        ...


class Translation:
    """POMF of the target with the source turned into the target's orientation, on one device and grid."""

    def __init__(self, device: Device, edge: int) -> None:
        """Plan the volume and its transforms."""
        self.device, self.edge = device, edge
        cube = (edge, edge, edge)
        self._pomf = Pomf(device, cube, BLUR)
        self._volume = device.empty(cube)
        self._spectrum = device.empty((edge, edge, edge // 2 + 8), np.complex64)
        self._correlation = device.empty(cube)

    def correlate(self, target: Volume, source: Volume, R_target_source: Rotation) -> Array:
        """The correlation (N, N, N) float32; a peak at s means p_target = R p_source + s about the grid centers.

        The points are turned and put into voxels anew: turning the voxel data would blur them.
        The array is used again by the next call.
        """
        voxelize(self.device, source.points, self.edge, R=R_target_source.as_matrix(), out=self._volume)
        self._pomf.prepare(self._volume, out=self._spectrum)
        return self._pomf.correlate(target.spectrum, self._spectrum, out=self._correlation)

    def find(self, target: Volume, source: Volume, R_target_source: Rotation) -> Peak:
        """The highest peak of the correlation."""
        return find_peaks(self.device, self.correlate(target, source, R_target_source))[0]

    def find_all(
        self, target: Volume, source: Volume, R_target_source: Rotation, count: int, separation: float
    ) -> list[Peak]:
        """The `count` highest peaks of the correlation, farther than `separation` [voxels] from each other."""
        correlation = self.correlate(target, source, R_target_source)
        return find_peaks(self.device, correlation, count=count, separation=separation)

    def find_at(self, target: Volume, source: Volume, R_target_source: Rotation, shift: np.ndarray) -> Peak:
        """The highest place within a voxel of a shift (3,) [voxels], be it a peak or on the slope of another."""
        correlation = self.correlate(target, source, R_target_source)
        return peak_at(self.device, correlation, np.rint(shift).astype(np.int64))

    def find_others(self, target: Volume, source: Volume, R_target_source: Rotation, separation: float) -> list[Peak]:
        """The next highest peak of the correlation, farther than `separation` [voxels] from the highest, if any."""
        correlation = self.correlate(target, source, R_target_source)
        return find_peaks(self.device, correlation, count=2, separation=separation)[1:]
