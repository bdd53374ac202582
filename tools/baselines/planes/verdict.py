"""Whether to believe planes that agree, and why."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from tools.baselines.conclusion import Verdict
from tools.baselines.planes.consensus import Consensus
from tools.baselines.planes.patch import Patches
from tools.baselines.planes.pose import LOOSE_ROTATION, PlanePose, fixed_and_open

# The largest standard deviations with which a transform is believed: of a turn [rad], of a shift [voxels].
LARGEST_TURN = float(np.deg2rad(3.0))
LARGEST_SHIFT = 3.0
# Chance brings a few planes together: so many more than any other answer must agree, as a ratio, and at least so many.
LEAST_DISTINCTION = 1.25
FEWEST_PLANES = 5
LEAST_AREA = 0.15
LEAST_OVERLAP = 0.1
# Answers nearer than this to each other are one [rad; voxels].
_SAME_ROTATION = float(np.deg2rad(10.0))
_SAME_SHIFT = 6.0


def nothing_found(farthest: float) -> PlanePose:
    """The identity, known to nothing better than any angle and `farthest` [m]."""
    return PlanePose(RigidTransform.identity(), np.diag([LOOSE_ROTATION**2] * 3 + [farthest**2] * 3))


def judge(found: Sequence[Consensus], target: Patches, source: Patches, voxel: float, overlap: float) -> Verdict:
    """Whether to believe the first consensus, and the reason in words.

    Args:
        found: best first; may be empty.
        target, source: the patches that were matched.
        voxel: edge of a voxel [m].
        overlap: the share of points in common under it, 0..1.
    """
    if not found:
        return Verdict(False, f"no two of {len(target)} and {len(source)} planes agree on a transform")
    best = found[0]
    open_ways = _open_ways(target.take(best.target), best.pose, voxel)
    if open_ways:
        return Verdict(False, f"{len(best)} planes agree, and {open_ways}")
    rival = max((len(other) for other in found[1:] if _differ(best, other, voxel)), default=0)
    area = best.area / min(target.area.sum(), source.area.sum())
    told = (
        f"{len(best)} planes agree, of the next answer {rival}; they are {area:.0%} of the planes' area; "
        f"{overlap:.0%} of the points are shared"
    )
    if len(best) < FEWEST_PLANES:
        return Verdict(False, f"{told}; believed from {FEWEST_PLANES} planes on")
    if len(best) < LEAST_DISTINCTION * rival:
        return Verdict(False, f"{told}; believed from {LEAST_DISTINCTION:g} times as many on")
    if area < LEAST_AREA:
        return Verdict(False, f"{told}; believed from {LEAST_AREA:.0%} of the area on")
    if overlap < LEAST_OVERLAP:
        return Verdict(False, f"{told}; believed from {LEAST_OVERLAP:.0%} of the points on")
    return Verdict(True, told)


def _open_ways(planes: Patches, pose: PlanePose, voxel: float) -> str:
    """What the planes leave open, in words; "" where nothing."""
    ways = {1: "one direction is", 2: "two directions and a turn are"}.get(len(fixed_and_open(planes.normal)[1]))
    if ways:
        return f"no three of them span space: {ways} taken from where the patches lie"
    turn = float(np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1]))
    shift = float(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1]))
    if turn > LARGEST_TURN or shift > LARGEST_SHIFT * voxel:
        return (
            f"fix it to {np.rad2deg(turn):.1f} degrees and {shift:.1f} m only (one standard deviation); believed up to "
            f"{np.rad2deg(LARGEST_TURN):g} degrees and {LARGEST_SHIFT * voxel:.1f} m"
        )
    return ""


def _differ(a: Consensus, b: Consensus, voxel: float) -> bool:
    """Whether two answers are different, and not one found twice."""
    apart = a.pose.T_target_source.inv() * b.pose.T_target_source
    turned = apart.rotation.magnitude() > _SAME_ROTATION
    return bool(turned or np.linalg.norm(apart.translation) > _SAME_SHIFT * voxel)
