"""A registration with its truth: its errors, whether it is right, and which step is wrong first."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, PairError, pair_error

Step = Literal["", "yaw", "tilt", "translation"]


@dataclass(frozen=True, slots=True)
class ScoredRegistration:
    """A registration with its truth.

    Attributes:
        registration: of the pair.
        truth: the true T_target_source, between the sensor frames.
        center: (3,) [m, sensor frame of the source], where the scan's grid was centered.
        voxel: of the grid [m].
    """

    registration: Registration
    truth: RigidTransform
    center: np.ndarray
    voxel: float

    @property
    def error(self) -> PairError:
        """Of T_target_source, so the translation's at the sensor: it decides what is right."""
        return pair_error(self.registration.T_target_source, self.truth)

    @property
    def center_m(self) -> float:
        """How far from its true place the scan's center comes to lie [m].

        A scan's center is far from its sensor; what the rotation lacks moves one of them more than the other.
        """
        estimated = self.registration.T_target_source.apply(self.center)
        return float(np.linalg.norm(estimated - self.truth.apply(self.center)))

    @property
    def right(self) -> bool:
        """Whether it is within RIGHT_DEG and, at the sensor, RIGHT_VOXELS of the truth."""
        return self.error.within(RIGHT_DEG, RIGHT_VOXELS * self.voxel)

    @property
    def right_at_center(self) -> bool:
        """The same, the translation taken at the scan's center."""
        return self.error.rotation_deg <= RIGHT_DEG and self.center_m <= RIGHT_VOXELS * self.voxel

    @property
    def wrong_step(self) -> Step:
        """The first of the paper's steps whose result is wrong; "" where it is right."""
        if self.right:
            return ""
        if self.error.rotation_deg <= RIGHT_DEG:
            return "translation"
        estimated, true = (T.rotation.as_euler("ZYX", degrees=True) for T in (self._found, self.truth))
        yaw = (estimated[0] - true[0] + 180) % 360 - 180
        return "yaw" if abs(yaw) > RIGHT_DEG else "tilt"

    @property
    def _found(self) -> RigidTransform:
        return self.registration.T_target_source
