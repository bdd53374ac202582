"""One pose that the paper's chain ends at: whether two of them are the same, and whether to believe it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.tilt import tilt_refusal
from sonarmap.spectral.translation import SAME_SHIFT

# Rotations nearer than this to each other are the same answer [rad].
_SAME_ROTATION = float(np.deg2rad(10.0))


@dataclass(frozen=True, slots=True)
class Match:
    """A rotation, the translation's peak under it, and the peak-to-sidelobe ratios of the steps before."""

    R: Rotation  # R_target_source
    peak: Peak  # of the translation's correlation under it [voxels]
    # yaw_psr, tilt_psr: of the peaks that yaw, and roll and pitch, were read from; 0 where there was none
    yaw_psr: float
    tilt_psr: float


def differ(a: Match, b: Match, edge: int) -> bool:
    """Whether two matches on a grid of `edge` voxels are different answers."""
    turned = (a.R.inv() * b.R).magnitude() > _SAME_ROTATION
    apart = (a.peak.shift - b.peak.shift + edge / 2) % edge - edge / 2  # a shift is known up to the grid's edge
    return bool(turned or np.linalg.norm(apart) > SAME_SHIFT)


@dataclass(frozen=True, slots=True)
class Acceptance:
    """When a registration is accepted."""

    # the least peak-to-sidelobe ratio of the translation, on a grid of up to 128 voxels per edge. On larger ones false
    # peaks are higher, and it grows with (edge / 128)^0.75.
    psr: float = 30.0
    distinction: float = 1.7  # the least ratio between it and that of any other answer
    overlap: float = 0.05  # the least share of points in common


def assess(
    best: Match, rival: float, overlap: float, least: Acceptance, max_tilt: float, grid: Grid
) -> tuple[bool, str]:
    """Whether to believe the best match, and the reason in words.

    Args:
        rival: the peak-to-sidelobe ratio of the next best answer.
        overlap: the share of points in common under it, 0..1.
        max_tilt: largest roll and pitch [rad]; 3 degrees more are let through.
    """
    psr, least_psr = best.peak.psr, least.psr * max(1.0, grid.edge / 128) ** 0.75
    if refusal := tilt_refusal(best.R, max_tilt):
        return False, refusal
    if psr < least_psr:
        words = f"no shift stands out: the translation's peak is {psr:.1f} standard deviations high"
        return False, f"{words}; believed from {least_psr:.0f} on"
    if psr < least.distinction * rival:
        return False, (
            f"two answers fit alike: the translation's peak is {psr:.1f} standard deviations high and another answer's "
            f"{rival:.1f}; believed from {least.distinction:g} times as high on"
        )
    if overlap < least.overlap:
        return False, f"the scans share too little, {overlap:.1%} of their points; believed from {least.overlap:.0%} on"
    return True, (
        f"the scans match: the translation's peak is {psr:.1f} standard deviations high, the next answer's "
        f"{rival:.1f}; {overlap:.0%} of the points are shared"
    )
