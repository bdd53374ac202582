"""The motion by dead reckoning, and the learned motion for other scans."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose

_UNKNOWN_SIGMAS = np.repeat([np.pi, 1e3], 3)  # of a motion about which nothing is known [rad, m]


@dataclass(frozen=True, slots=True)
class MeasuredMotion:
    """Dead reckoning, and the learned motion for scans that it does not cover."""

    odometry: Odometry
    learned: Motion | None  # None if none could be learned
    floor: np.ndarray  # (6,) standard deviations added to those of dead reckoning [rad, m]

    def expected(self, i: int, j: int) -> ExpectedPose:
        """The expected T_i_j."""
        if self.is_measured(i, j):
            return self.odometry.expected(i, j, self.floor)
        if self.learned is not None:
            return self.learned.expected(i, j)
        return ExpectedPose.along_target(RigidTransform.identity(), _UNKNOWN_SIGMAS)

    def way(self, i: int, j: int) -> tuple[float, float] | None:
        """The learned distance; None where dead reckoning covers the scans."""
        return None if self.learned is None or self.is_measured(i, j) else self.learned.way(i, j)

    def following(self, pairs: Sequence[RegisteredPair]) -> "MeasuredMotion":
        """With the learned motion following these pairs."""
        return self if self.learned is None else replace(self, learned=self.learned.following(pairs))

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a registration contradicts dead reckoning, or else the usual motion."""
        if self.is_measured(i, j):
            return self.odometry.contradicts(i, j, T_i_j, self.floor)
        return self.learned is not None and self.learned.contradicts(i, j, T_i_j)

    def unlikelihood(self, i: int, j: int, T_i_j: RigidTransform) -> float:
        """That of the learned motion; 0 where dead reckoning covers the scans, which is in the graph itself."""
        return 0.0 if self.learned is None or self.is_measured(i, j) else self.learned.unlikelihood(i, j, T_i_j)

    def is_beyond(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a registration contradicts dead reckoning, or else is out of reach."""
        if self.is_measured(i, j):
            return self.odometry.contradicts(i, j, T_i_j, self.floor)
        return self.learned is not None and self.learned.is_beyond(i, j, T_i_j)

    def is_measured(self, i: int, j: int) -> bool:
        """Whether dead reckoning covers both scans."""
        return self.odometry.tells(i, j)


AnyMotion = Motion | MeasuredMotion
