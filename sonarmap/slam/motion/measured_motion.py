"""The motion that instruments measured, where they did, and the learned one elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose

# Where nothing is known of the motion, a scan may be anywhere [rad, m].
_ANYWHERE = np.repeat([np.pi, 1e3], 3)


@dataclass(frozen=True, slots=True)
class MeasuredMotion:
    """Dead reckoning, and the learned motion for scans that it does not tell of."""

    odometry: Odometry  # what was measured
    learned: Motion | None  # None where nothing could be learned
    floor: np.ndarray  # (6,) standard deviations that what was measured is granted [rad, m]

    def expected(self, i: int, j: int) -> ExpectedPose:
        """T_i_j."""
        if self.is_measured(i, j):
            return self.odometry.expected(i, j, self.floor)
        if self.learned is not None:
            return self.learned.expected(i, j)
        return ExpectedPose.along_target(RigidTransform.identity(), _ANYWHERE)

    def way(self, i: int, j: int) -> tuple[float, float] | None:
        """As learned, where dead reckoning does not tell it better."""
        return None if self.learned is None or self.is_measured(i, j) else self.learned.way(i, j)

    def following(self, pairs: Sequence[RegisteredPair]) -> "MeasuredMotion":
        """The learned part follows them."""
        return self if self.learned is None else replace(self, learned=self.learned.following(pairs))

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a registration is too far from what was measured, or from what is usual."""
        if self.is_measured(i, j):
            return self.odometry.contradicts(i, j, T_i_j, self.floor)
        return self.learned is not None and self.learned.contradicts(i, j, T_i_j)

    def unlikelihood(self, i: int, j: int, T_i_j: RigidTransform) -> float:
        """As learned; 0 where dead reckoning is in the graph itself."""
        return 0.0 if self.learned is None or self.is_measured(i, j) else self.learned.unlikelihood(i, j, T_i_j)

    def is_beyond(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a registration contradicts what was measured, or is out of reach."""
        if self.is_measured(i, j):
            return self.odometry.contradicts(i, j, T_i_j, self.floor)
        return self.learned is not None and self.learned.is_beyond(i, j, T_i_j)

    def is_measured(self, i: int, j: int) -> bool:
        """Whether dead reckoning tells of both scans."""
        return self.odometry.tells(i, j)


AnyMotion = Motion | MeasuredMotion
