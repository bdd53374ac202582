"""Whether to believe what a baseline found, by the measures of its own kind.

The thresholds are from eight simulated pairs at the noise of the paper and voxels of 1 m, seeds 100 to 107 of
`random_pair` on three scenes, and five pairs of scans that have nothing to do with each other. That is few: they tell
these apart, and are fitted to them.
"""

from scipy.spatial.transform import RigidTransform

from tools.baselines.agreement import REACH, overlap
from tools.baselines.cloud import Cloud
from tools.baselines.conclusion import Verdict

# The share of points in common says little by itself: beds laid on each other share up to 0.7 wherever they come from.
_LEAST_FITNESS = 0.1
# How many of these are near, within half the distance: 0.84..0.95 where right, 0.50..0.81 where wrong. (The inlier
# rms of Open3D says the same; a share is not moved by a few.) Voxels of less than the noise lower it. The threshold
# lies where one wrong answer, 79 degrees off at 0.81, is refused.
_LEAST_CLOSE = 0.83
# Matches that agree with a wrong transform by chance: up to 14; with a right one mostly 21 and more, 17 and 4 once
# each, which are refused.
_LEAST_MATCHES = 20


def judge_fit(target: Cloud, source: Cloud, T_target_source: RigidTransform, voxel: float) -> Verdict:
    """By the share of points in common, and by how close these are: ICP's fitness and inlier distance."""
    fitness, near = (overlap(target, source, T_target_source, reach * voxel) for reach in (REACH, REACH / 2))
    close = near / fitness if fitness > 0 else 0.0
    far = REACH * voxel
    words = f"{fitness:.0%} of the points are within {far:.3g} m of the other scan, {close:.0%} of these within half"
    if fitness < _LEAST_FITNESS:
        return Verdict(False, f"{words}; believed from {_LEAST_FITNESS:.0%} on")
    if close < _LEAST_CLOSE:
        return Verdict(False, f"{words}; believed from {_LEAST_CLOSE:.0%} of these on")
    return Verdict(True, words)


def judge_matches(agreeing: int, matches: int, least: int = _LEAST_MATCHES) -> Verdict:
    """By the number of matched features that agree with the transform."""
    words = f"{agreeing} of {matches} matched features agree"
    return Verdict(True, words) if agreeing >= least else Verdict(False, f"{words}; believed from {least} on")
