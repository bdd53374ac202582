"""From a transform and a method's own word on it to a Registration."""

from dataclasses import dataclass
from time import perf_counter

from scipy.spatial.transform import RigidTransform

from spectral.result import Registration
from tools.baselines.agreement import REACH, covariance, overlap
from tools.baselines.cloud import Cloud

NO_PEAK = float("nan")  # what a method that correlates nothing has for a peak-to-sidelobe ratio: null in JSON


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a method believes its result, and why, in words."""

    accepted: bool
    reason: str


def conclude(
    target: Cloud, source: Cloud, T_target_source: RigidTransform, voxel: float, verdict: Verdict, start: float
) -> Registration:
    """The result of a pair that was begun at `start` (perf_counter)."""
    return Registration(
        T_target_source=T_target_source,
        covariance=covariance(target, source, T_target_source, voxel),
        psr=NO_PEAK,
        overlap=overlap(target, source, T_target_source, REACH * voxel),
        accepted=verdict.accepted,
        seconds=perf_counter() - start,
        reason=verdict.reason,
    )
