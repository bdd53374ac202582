"""One pose that the paper's chain ends at, and whether two of them are the same."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.translation import SAME_SHIFT

# Rotations nearer than this to each other are the same answer [rad].
_SAME_ROTATION = float(np.deg2rad(10.0))


@dataclass(frozen=True, slots=True)
class Match:
    """A rotation, the translation's peak under it, and the peak-to-sidelobe ratios of the steps before.

    Attributes:
        R: R_target_source.
        peak: of the translation's correlation under it [voxels].
        yaw_psr, tilt_psr: of the peaks that yaw, and roll and pitch, were read from; 0 where there was none.
    """

    R: Rotation
    peak: Peak
    yaw_psr: float
    tilt_psr: float


def differ(a: Match, b: Match, edge: int) -> bool:
    """Whether two matches on a grid of `edge` voxels are different answers."""
    turned = (a.R.inv() * b.R).magnitude() > _SAME_ROTATION
    apart = (a.peak.shift - b.peak.shift + edge / 2) % edge - edge / 2  # a shift is known up to the grid's edge
    return bool(turned or np.linalg.norm(apart) > SAME_SHIFT)


def by_peak(match: Match) -> float:
    """Sorts the highest peak to the front."""
    return -match.peak.psr
