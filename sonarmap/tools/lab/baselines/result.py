"""A baseline's result: the share of points in common, its covariance, and whether to believe it.

The thresholds of acceptance are from eight simulated pairs at the noise of the paper and voxels of 1 m, seeds 100 to
107 of `random_pair` on three scenes, and five pairs of scans that share nothing. That is few: they separate these
pairs, and are fitted to them.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.baselines.cloud import NORMAL_REACH, ThinnedCloud, thin

# A point has a counterpart within this distance, as in spectral/hemisphere.py [voxels].
REACH = 2.0

# Normals and what is off along them are shared by the points of one neighborhood: so many of them count as one.
_ALIKE = np.pi * NORMAL_REACH**2
# Two scans that agree exactly, as a scan with itself, are no surer than this [voxels, standard deviation of a point].
_LEAST_SIGMA = 0.05

# The share of points in common says little by itself: beds laid on each other share up to 0.7 wherever they come from.
_LEAST_FITNESS = 0.1
# How many of these are near, within half the distance: 0.84..0.95 where right, 0.50..0.81 where wrong. (The inlier
# rms of Open3D says the same; a share is not moved by a few.) Voxels of less than the noise lower it. The threshold
# lies where one wrong answer, 79 degrees off at 0.81, is refused.
_LEAST_CLOSE = 0.83
# Matches that agree with a wrong transform by chance: up to 14; with a right one mostly 21 and more, 17 and 4 once
# each, which are refused.
_LEAST_MATCHES = 20

NO_PEAK = float("nan")  # what a method that correlates nothing has for a peak-to-sidelobe ratio: null in JSON


@dataclass(frozen=True, slots=True)
class MethodVerdict:
    """Whether a method believes its result, and why, in words."""

    accepted: bool
    reason: str


def verdict(words: str, *wanted: tuple[bool, str]) -> MethodVerdict:
    """Refused by the first condition that is not met, each with the words from what on a result is believed."""
    missed = next((least for met, least in wanted if not met), "")
    return MethodVerdict(not missed, f"{words}; believed from {missed} on" if missed else words)


class PointRegistrar(ABC):
    """A registrar that works on points: the result is `solve`'s transform, with covariance and overlap of the points.

    Args:
        voxel: edge of the voxels to which scans are thinned [m]; the distances that a method uses are multiples of it.
    """

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel

    def prepare(self, scan: Scan) -> ThinnedCloud:
        """The scan's points, one per voxel, and what the method adds.

        Raises:
            InputError: they are too few.
        """
        cloud = thin(scan, self.voxel)
        return replace(cloud, extra=self.describe(cloud))

    def register(self, target: ThinnedCloud, source: ThinnedCloud) -> Registration:
        """Find T_target_source; `accepted` says whether the method believes it."""
        start = perf_counter()
        T_target_source, verdict = self.solve(target, source)
        return Registration(
            T_target_source=T_target_source,
            covariance=covariance(target, source, T_target_source, self.voxel),
            psr=NO_PEAK,
            overlap=overlap(target, source, T_target_source, REACH * self.voxel),
            accepted=verdict.accepted,
            seconds=perf_counter() - start,
            reason=verdict.reason,
        )

    def describe(self, cloud: ThinnedCloud) -> Any:
        """What `ThinnedCloud.extra` is to be."""
        return None

    @abstractmethod
    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, MethodVerdict]:
        """T_target_source, and whether to believe it."""


def judge_fit(target: ThinnedCloud, source: ThinnedCloud, T: RigidTransform, voxel: float) -> MethodVerdict:
    """By the share of points in common, and by how close these are: ICP's fitness and inlier distance."""
    fitness, near = (overlap(target, source, T, reach * voxel) for reach in (REACH, REACH / 2))
    close, far = near / fitness if fitness > 0 else 0.0, REACH * voxel
    return verdict(
        f"{fitness:.0%} of the points are within {far:.3g} m of the other scan, {close:.0%} of these within half",
        (fitness >= _LEAST_FITNESS, f"{_LEAST_FITNESS:.0%}"),
        (close >= _LEAST_CLOSE, f"{_LEAST_CLOSE:.0%} of these"),
    )


def judge_matches(agreeing: int, matches: int, least: int = _LEAST_MATCHES) -> MethodVerdict:
    """By the number of matched features that agree with the transform."""
    return verdict(f"{agreeing} of {matches} matched features agree", (agreeing >= least, str(least)))


def overlap(target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, reach: float) -> float:
    """The share of points, one per voxel, with a counterpart within `reach` [m]; the smaller of both ways, 0..1."""
    moved = T_target_source.apply(source.points)
    back = T_target_source.inv().apply(target.points)
    return min(_share(target, moved, reach), _share(source, back, reach))


def _share(cloud: ThinnedCloud, points: np.ndarray, reach: float) -> float:
    distance, _ = cloud.tree.query(points, distance_upper_bound=reach)
    return float(np.isfinite(distance).mean())


def covariance(target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, voxel: float) -> np.ndarray:
    """The 6x6 covariance of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m].

    It is the inverse of the Gauss-Newton Hessian of the distances between the source's points and the target's
    surface at their nearest points (point-to-plane), over their variance. Along a surface its points slide, as
    those of any ICP do: that way the Hessian sees nothing, and the variance is large; a direction that nothing fixes
    has that of the scan's own size. What is wrong with all points alike, as by false neighbors, is not seen: on
    simulated pairs the normalized squared error has a median of about 15, where six degrees of freedom should give 6,
    and more than 100 where little is shared.
    """
    moved = T_target_source.apply(source.points)
    distance, nearest = target.tree.query(moved, distance_upper_bound=REACH * voxel)
    near = np.isfinite(distance)
    normals = target.normals[nearest[near]]
    off = np.sum(normals * (moved[near] - target.points[nearest[near]]), axis=1)
    # about the middle of the points: n . (R (w x p + v)) = w . (p x m) + v . m with m = R^T n
    turned = T_target_source.rotation.inv().apply(normals) if len(normals) else normals
    middle = source.points.mean(axis=0)
    J = np.hstack([np.cross(source.points[near] - middle, turned), turned])
    variance = max(float(np.mean(off**2)) if len(off) else 0.0, (_LEAST_SIGMA * voxel) ** 2)
    extent = float(np.linalg.norm(np.ptp(source.points, axis=0)))
    unknown = np.diag(np.repeat([np.pi, extent], 3) ** -2.0)
    about_middle = np.linalg.inv(J.T @ J / (variance * _ALIKE) + unknown)
    shift = np.eye(6)  # adjoint of the translation from the source's sensor to the middle
    shift[3:, :3] = np.cross(middle, np.eye(3)).T
    moved_covariance = shift @ about_middle @ shift.T
    return (moved_covariance + moved_covariance.T) / 2
