"""The rotation, made finer by the translation's peak: it is highest where the turned source fits best."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.prepare.prepared import Prepared
from sonarmap.spectral.translation import Translation

# Half-widths of the search, coarse to fine [rad]. The first reaches as far as a hypothesis may be off: on the simulated
# pairs that this was chosen on, one in ten stayed 6 degrees from the truth with steps of 2, 1 and 0.5 degrees, and one
# in ten 1.4 degrees with these (one of 42 still 13.7: another top is near).
STEPS = tuple(np.deg2rad([6.0, 3.0, 1.5, 0.7]))


def search_rotation(
    translation: Translation,
    target: Prepared,
    source: Prepared,
    R_target_source: Rotation,
    peak: Peak,
) -> tuple[Rotation, Peak]:
    """Climb from a rotation and its peak to one nearby under which the translation's peak is highest, and that peak.

    Each step tries the rotation vector's three axes either way, fits a parabola through each, and tries where their
    tops lie: a fixed number of correlations, seven a step.
    """
    R = R_target_source

    def peaks_under(turned: Rotation) -> list[Peak]:
        free = [None] * len(turned)
        return [of[0][0] for of in translation.find_within(target, source, turned, free, 1, 3.0)]

    for step in STEPS:
        sides = Rotation.from_rotvec(step * np.concatenate([-np.eye(3), np.eye(3)])) * R
        beside = peaks_under(sides)
        left, right = (np.array([found.psr for found in half]) for half in (beside[:3], beside[3:]))
        top = [step * _parabola_top(low, peak.psr, high) for low, high in zip(left, right, strict=True)]
        combined = Rotation.from_rotvec([top]) * R
        # in this order the first of equal ones is kept: where it was, axis by axis the lower side, the top
        tried = [(R, peak), *((sides[n], beside[n]) for n in (0, 3, 1, 4, 2, 5))]
        tried.append((combined[0], peaks_under(combined)[0]))
        R, peak = max(tried, key=lambda turn_and_peak: turn_and_peak[1].psr)
    return R, peak


def _parabola_top(left: float, middle: float, right: float) -> float:
    """Where the parabola through values at -1, 0, 1 has its top, within -1..1; the higher side where it has none."""
    curvature = left - 2 * middle + right
    if curvature >= 0:
        return float(np.sign(right - left))
    return float(np.clip(0.5 * (left - right) / curvature, -1.0, 1.0))
