"""One way in which two scans may fit together."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.pomf.peak import Peak

# Hypotheses nearer than this to each other are one answer found twice [rad; voxels].
SAME_ROTATION = float(np.deg2rad(10.0))
SAME_SHIFT = 6.0


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A rotation, the translation's peak under it, and the peak-to-sidelobe ratios on the way there."""

    R: Rotation
    peak: Peak
    yaw_psr: float
    tilt_psr: float


def differ(a: Hypothesis, b: Hypothesis, edge: int) -> bool:
    """Whether two hypotheses on a grid of `edge` voxels are different answers, and not the same one found twice."""
    turned = (a.R.inv() * b.R).magnitude() > SAME_ROTATION
    apart = (a.peak.shift - b.peak.shift + edge / 2) % edge - edge / 2  # a shift is known up to the grid's edge
    return bool(turned or np.linalg.norm(apart) > SAME_SHIFT)


def largest_tilt(R: Rotation) -> np.ndarray:
    """The larger of roll and pitch [rad], R = Rz(yaw) Ry(pitch) Rx(roll): () for one rotation, (n,) for a stack."""
    return np.abs(R.as_euler("ZYX")[..., 1:]).max(axis=-1)


def by_peak(hypothesis: Hypothesis) -> float:
    """Sorts the highest peak to the front."""
    return -hypothesis.peak.psr
