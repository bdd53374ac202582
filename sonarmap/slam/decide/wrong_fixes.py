# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Measurements of instruments that all others contradict: an acoustic outlier, a compass that jumped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import chdtri

from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.spectral.measured import measured_rotation, twist
from sonarmap.spectral.scan import PosePrior

# What an instrument tells, and its numbers among a prior's sigmas.
KINDS = {"attitude": slice(0, 2), "heading": slice(2, 3), "position": slice(3, 5), "depth": slice(5, 6)}
# Degrees of freedom of the errors' tails, and how often fixes are weighed anew.
_TAILS, _REWEIGHTED = 2.0, 8
# A fix is wrong where one of so many right ones is as far off.
_RARE = 1e-5
# Where more than this share of the fixes of a kind seem wrong, it is not they that are.
_MOST = 0.3


@dataclass(frozen=True, slots=True)
class WrongFix:
    """A measurement that was left out.

    Attributes:
        scan: its index.
        kind: of KINDS.
        sigmas: how far it is from what all others say, in standard deviations of one number that is as rare.
    """

    scan: int
    kind: str
    sigmas: float


def without_wrong_fixes(
    graph: PoseGraph, priors: Mapping[int, PosePrior]
) -> tuple[dict[int, PosePrior], tuple[WrongFix, ...]]:
    """The priors without those that the edges and the other priors contradict, and which these are.

    Reweighted least squares with heavy tails (Student's t): a fix far off pulls less and less, until the others say
    where the pose is. A fix that nothing else bears on is never wrong.

    Args:
        graph: edges between the poses, these about where they are in the world; its own priors do not count.
        priors: what instruments measured, by pose.
    """
    if not priors:
        return {}, ()
    fixes = _Fixes.of(priors)
    weights = np.ones(fixes.known.shape)
    of_edges = np.ones(len(graph.edges))
    solution = None
    for _ in range(_REWEIGHTED):
        weighed = tuple(zip(fixes.poses.tolist(), fixes.weighed(weights), strict=True))
        solution = replace(graph, priors=weighed).optimize(doubts=1 / of_edges)
        graph = graph.at(solution.trajectory.T_world_sensor)
        # edges may be wrong as well as fixes
        of_edges = np.minimum(1.0, (_TAILS + 6) / (_TAILS + solution.residuals**2 / of_edges))
        before = weights
        weights = np.where(fixes.known, fixes.doubted(solution.trajectory.T_world_sensor), 1.0)
        if np.abs(weights - before).max() < 1e-2:
            break
    assert solution is not None
    wrong = _wrong(solution, fixes, weights)
    if not wrong or _too_many(wrong, fixes):
        return dict(priors), ()
    left_out = {(fix.scan, fix.kind) for fix in wrong}
    cleaned = {k: _without(prior, {kind for kind in KINDS if (k, kind) in left_out}) for k, prior in priors.items()}
    return {k: prior for k, prior in cleaned.items() if prior is not None}, wrong


@dataclass(frozen=True, slots=True)
class _Fixes:
    """What was measured of n poses, by the K kinds of KINDS.

    Attributes:
        poses: (n,) int.
        priors: n.
        R: n measured rotations, level where the attitude is not measured.
        places: (n, 3) measured translations [m].
        sigmas: (n, 6) as of a `PosePrior`.
        known: (n, K) bool, what was measured.
    """

    poses: np.ndarray
    priors: tuple[PosePrior, ...]
    R: Rotation
    places: np.ndarray
    sigmas: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, priors: Mapping[int, PosePrior]) -> "_Fixes":
        poses = sorted(priors)
        those = tuple(priors[k] for k in poses)
        sigmas = np.stack([prior.sigmas for prior in those])
        return cls(
            np.array(poses, np.intp),
            those,
            Rotation.concatenate([measured_rotation(prior) for prior in those]),
            np.stack([prior.T_world_sensor.translation for prior in those]),
            sigmas,
            np.column_stack([np.isfinite(sigmas[:, numbers]).all(axis=1) for numbers in KINDS.values()]),
        )

    def weighed(self, weights: np.ndarray) -> list[PosePrior]:
        """The priors with what weighs less, (n, K), less sure."""
        sigmas = self.sigmas.copy()
        for kind, numbers in enumerate(KINDS.values()):
            sigmas[:, numbers] /= np.sqrt(weights[:, kind, None])
        return [replace(prior, sigmas=own) for prior, own in zip(self.priors, sigmas, strict=True)]

    def doubted(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, K) weights by how far the poses are from what was measured."""
        squared = (self.residuals(T_world_sensor) / self.sigmas) ** 2
        sums = np.column_stack([squared[:, numbers].sum(axis=1) for numbers in KINDS.values()])
        sizes = np.array([numbers.stop - numbers.start for numbers in KINDS.values()])
        return np.minimum(1.0, (_TAILS + sizes) / (_TAILS + sums))

    def residuals(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, 6) how far poses are from what was measured, in the world's axes [rad, m]."""
        T = T_world_sensor[self.poses]
        up, there = (R.inv().apply([0.0, 0.0, 1.0]) for R in (self.R, T.rotation))
        turned = T.rotation.apply(np.cross(there, up))
        turned[:, 2] = twist(T.rotation * self.R.inv())
        return np.hstack([turned, T.translation - self.places])


def _wrong(solution: Solution, fixes: _Fixes, weights: np.ndarray) -> tuple[WrongFix, ...]:
    """Those that are farther from the estimate than both are unsure."""
    suspects = np.argwhere(fixes.known & (weights < 1.0))
    if not len(suspects):
        return ()
    T, covariances, found = solution.trajectory.T_world_sensor, solution.covariances(), []
    residuals, names = fixes.residuals(T), list(KINDS)
    for n, kind in suspects.tolist():
        numbers, k = KINDS[names[kind]], int(fixes.poses[n])
        R = T[k].rotation.as_matrix()
        in_world = block_diag(R, R)[numbers]  # by the pose's body tangent
        together = in_world @ covariances[k] @ in_world.T + np.diag(fixes.sigmas[n, numbers] ** 2)
        residual = residuals[n, numbers]
        squared = float(residual @ np.linalg.solve(together, residual))
        if squared > chdtri(len(residual), _RARE):
            found.append(WrongFix(k, names[kind], float(np.sqrt(squared))))
    return tuple(sorted(found, key=lambda fix: (fix.scan, fix.kind)))


def _too_many(wrong: Sequence[WrongFix], fixes: _Fixes) -> bool:
    """Whether so many fixes of a kind seem wrong that rather the edges are."""
    return any(
        sum(fix.kind == name for fix in wrong) > _MOST * fixes.known[:, kind].sum() for kind, name in enumerate(KINDS)
    )


def _without(prior: PosePrior, kinds: set[str]) -> PosePrior | None:
    """The prior without these kinds; None where nothing is left."""
    sigmas = prior.sigmas.copy()
    for kind in kinds:
        sigmas[KINDS[kind]] = np.inf
    return replace(prior, sigmas=sigmas) if np.isfinite(sigmas).any() else None
