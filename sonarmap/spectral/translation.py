"""The shift between two scans once the rotation is known: Sect. 2.10 of the paper."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import Pending
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.pomf.correlator import Correlator, Pose, at_once
from sonarmap.kernels.pomf.peak import Peak

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
        """Device (N, N, `row_pitch(N)`) complex64 each, the spectrum of the volume whitened with each exponent."""
        ...


@dataclass(frozen=True, slots=True)
class Box:
    center: np.ndarray  # (3,) whole numbers [voxels]
    half: np.ndarray  # (3,) the largest distance from it along each axis [voxels]


class Translation:
    """POMF of the target with the source turned into the target's orientation, on one device and grid."""

    def __init__(self, device: Device, edge: int, exponents: tuple[float, ...] = (1.0,)) -> None:
        """Plan the correlations; the volumes to correlate are whitened with the same exponents."""
        self.device, self.edge, self.exponents = device, edge, exponents
        self._correlator = Correlator(device, edge, BLUR, exponents, at_once(edge))

    def find(self, target: Volume, source: Volume, R_target_source: Rotation) -> Peak:
        """The highest peak of the correlation with the first exponent: at s p_target = R p_source + s about the grid
        centers. The points are turned and put into voxels anew: turning the voxel data would blur them."""
        return self.find_within(target, source, Rotation.concatenate([R_target_source]), [None], 1, 3.0)[0][0][0]

    def find_others(self, target: Volume, source: Volume, R_target_source: Rotation, separation: float) -> list[Peak]:
        """The next highest peak of that correlation, farther than `separation` [voxels] from the highest, if any."""
        found = self.find_within(target, source, Rotation.concatenate([R_target_source]), [None], 2, separation)
        return found[0][0][1:]

    def find_within(
        self,
        target: Volume,
        source: Volume,
        R_target_source: Rotation,
        boxes: Sequence[Box | None],
        count: int,
        separation: float,
    ) -> list[list[list[Peak]]]:
        """For each of m rotations and each exponent the `count` highest peaks within its box, or all that are.

        They are farther than `separation` [voxels] apart. Within a box a peak's shift is what it names, and what the
        box moves out of the grid takes no part; without a box (None) a shift is one of those that are cyclically equal.
        """
        bounds = [box if self.is_bounded(box) else None for box in boxes]
        poses = [
            Pose(R) if box is None else Pose(R, box.center, box.half)
            for R, box in zip(R_target_source.as_matrix(), bounds, strict=True)
        ]
        peaks = self._correlator.find(source.points, poses, target.spectra, count, separation)
        return [
            each if box is None else [[replace(peak, shift=peak.shift + box.center) for peak in row] for row in each]
            for each, box in zip(peaks, bounds, strict=True)
        ]

    def is_bounded(self, box: Box | None) -> bool:
        """Whether a box is smaller than the grid."""
        return box is not None and bool((box.half < self.edge / 2).all())

    def find_at(
        self, target: Volume, source: Volume, R_target_source: Rotation, shifts: np.ndarray
    ) -> Pending[list[Peak]]:
        """The highest places within a voxel of shifts (m, 3) [voxels], one for each of m rotations; also on slopes."""
        poses = [Pose(R) for R in R_target_source.as_matrix()]
        places = np.rint(shifts).astype(np.int64)
        return self._correlator.near(source.points, poses, target.spectra, places)

    def profile(
        self, target: Volume, source: Volume, R_target_source: Rotation, shifts: np.ndarray
    ) -> Pending[np.ndarray]:
        """(exponents, m) the correlations under one rotation at shifts (m, 3) [voxels]."""
        return self._correlator.at(source.points, Pose(R_target_source.as_matrix()), target.spectra, shifts)
