"""The shift between two scans once the rotation is known: Sect. 2.10 of the paper."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import Pending
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.pomf.correlator import Correlator, FoundPeaks, Pose, at_once
from sonarmap.kernels.pomf.peak import Peak

# Standard deviation of the Gaussian that the correlation is smoothed with [voxels]. Noise and voxelization spread the
# true peak over its neighbors; without smoothing the highest voxel is often a wrong one.
BLUR = 0.7
# Shifts no farther apart than this are the same answer [voxels].
SAME_SHIFT = 6.0


class Volume(Protocol):
    """Points and spectra of a scan on a grid, such as `Prepared` or `CoarseVolume`."""

    @property
    def points(self) -> Array:
        """Device (n, 4) float32 [voxels from the grid's center; weight]."""
        ...

    @property
    def spectra(self) -> tuple[Array, ...]:
        """Spectra of the volume, one whitened with each exponent: device (N, N, `row_pitch(N)`) complex64."""
        ...


@dataclass(frozen=True, slots=True)
class Box:
    center: np.ndarray  # (3,) whole numbers [voxels]
    half: np.ndarray  # (3,) half widths along each axis [voxels]


class Translation:
    """POMF of the target with the source rotated into the target's axes, on one device and grid."""

    def __init__(self, device: Device, edge: int, exponents: tuple[float, ...] = (1.0,)) -> None:
        """Plan the correlations of volumes whitened with these exponents."""
        self.device, self.edge, self.exponents = device, edge, exponents
        self._correlator = Correlator(device, edge, BLUR, exponents, at_once(edge))

    def find(self, target: Volume, source: Volume, R_target_source: Rotation) -> Peak:
        """The two highest peaks of the correlation with the first exponent, or the only one, at s where p_target = R
        p_source + s about the grid centers. The rotated points are voxelized again, as rotating the voxels would blur
        them."""
        return self.find_within(target, source, Rotation.concatenate([R_target_source]), [None], 2, SAME_SHIFT).of(0)

    def find_within(
        self,
        target: Volume,
        source: Volume,
        R_target_source: Rotation,
        boxes: Sequence[Box | None],
        count: int,
        separation: float,
    ) -> FoundPeaks:
        """The `count` highest peaks, or fewer, for each of m rotations and each exponent, within the rotation's box.

        Peaks are farther than `separation` [voxels] apart. Within a box a peak's shift is the true one, and points that
        the box's center moves out of the grid are left out; without a box (None) shifts are cyclic.
        """
        bounds = [box if self.is_bounded(box) else None for box in boxes]
        poses = [
            Pose(R) if box is None else Pose(R, box.center, box.half)
            for R, box in zip(R_target_source.as_matrix(), bounds, strict=True)
        ]
        found = self._correlator.find(source.points, poses, target.spectra, count, separation)
        centers = np.array([np.zeros(3) if box is None else box.center for box in bounds]).reshape(-1, 3)
        return replace(found, peaks=replace(found.peaks, shift=found.peaks.shift + centers[found.pose]))

    def is_bounded(self, box: Box | None) -> bool:
        """Whether there is a box and it is smaller than the grid."""
        return box is not None and bool((box.half < self.edge / 2).all())

    def find_at(self, target: Volume, source: Volume, R_target_source: Rotation, shifts: np.ndarray) -> Pending[Peak]:
        """The highest values within a voxel of shifts (m, 3) [voxels], one for each of m rotations, peaks or not."""
        poses = [Pose(R) for R in R_target_source.as_matrix()]
        places = np.rint(shifts).astype(np.int64)
        return self._correlator.near(source.points, poses, target.spectra, places)

    def profile(
        self, target: Volume, source: Volume, R_target_source: Rotation, shifts: np.ndarray
    ) -> Pending[np.ndarray]:
        """(exponents, m) correlations under one rotation at shifts (m, 3) [voxels]."""
        return self._correlator.at(source.points, Pose(R_target_source.as_matrix()), target.spectra, shifts)
