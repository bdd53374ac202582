"""The rotation, made finer by the translation's peak: it is highest where the turned source fits best."""

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.pomf.peak import Peak
from spectral.prepare.prepared import Prepared
from spectral.translation import Translation

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
    stay: bool = False,
) -> tuple[Rotation, Peak]:
    """Climb to the rotation near the given one under which the translation's peak is highest.

    Each step tries the rotation vector's three axes either way, fits a parabola through each, and tries where their
    tops lie: a fixed number of correlations, seven a step.

    Args:
        R_target_source: where to begin.
        peak: of the translation, under this rotation.
        stay: whether to follow the given peak, step by step, instead of the highest: where it is known to be
            the right one.

    Returns:
        The best rotation that was tried and its peak.
    """
    R = R_target_source

    def peak_under(turned: Rotation) -> Peak:
        if stay:
            return translation.find_at(target, source, turned, peak.shift)
        return translation.find(target, source, turned)

    for step in STEPS:
        tried = [(R, peak)]
        top = np.zeros(3)
        for axis in range(3):
            turn = Rotation.from_rotvec(step * np.eye(3)[axis])
            pair = [(side * R, peak_under(side * R)) for side in (turn.inv(), turn)]
            tried += pair
            top[axis] = step * _parabola_top(pair[0][1].psr, peak.psr, pair[1][1].psr)
        combined = Rotation.from_rotvec(top) * R
        tried.append((combined, peak_under(combined)))
        R, peak = max(tried, key=lambda entry: entry[1].psr)
    return R, peak


def _parabola_top(left: float, middle: float, right: float) -> float:
    """Where the parabola through values at -1, 0, 1 has its top, within -1..1; the higher side where it has none."""
    curvature = left - 2 * middle + right
    if curvature >= 0:
        return float(np.sign(right - left))
    return float(np.clip(0.5 * (left - right) / curvature, -1.0, 1.0))
