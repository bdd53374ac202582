# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Measurements of instruments that all others contradict: an acoustic outlier, a compass that jumped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtri

from slam.graph.pose_graph import PoseGraph, Solution
from spectral.measured import measured_rotation, twist
from spectral.scan import PosePrior

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
    weights = {(k, kind): 1.0 for k, prior in priors.items() for kind in _kinds(prior)}
    of_edges = np.ones(len(graph.edges))
    solution = None
    for _ in range(_REWEIGHTED):
        weighed = {k: _weighed(prior, weights, k) for k, prior in priors.items()}
        solution = replace(graph.doubted(1 / of_edges), priors=tuple(sorted(weighed.items()))).optimize()
        graph = graph.at(solution.trajectory.T_world_sensor)
        # edges may be wrong as well as fixes
        of_edges = np.minimum(1.0, (_TAILS + 6) / (_TAILS + solution.residuals**2 / of_edges))
        before = dict(weights)
        for k, kind in weights:
            size = KINDS[kind].stop - KINDS[kind].start
            residual, _ = _residual(priors[k], solution.trajectory.T_world_sensor[k], kind)
            squared = float(((residual / priors[k].sigmas[KINDS[kind]]) ** 2).sum())
            weights[k, kind] = min(1.0, (_TAILS + size) / (_TAILS + squared))
        if max(abs(weights[key] - before[key]) for key in weights) < 1e-2:
            break
    assert solution is not None
    wrong = _wrong(solution, priors, weights)
    if not wrong or _too_many(wrong, weights):
        return dict(priors), ()
    left_out = {(fix.scan, fix.kind) for fix in wrong}
    cleaned = {k: _without(prior, {kind for kind in KINDS if (k, kind) in left_out}) for k, prior in priors.items()}
    return {k: prior for k, prior in cleaned.items() if prior is not None}, wrong


def _wrong(
    solution: Solution, priors: Mapping[int, PosePrior], weights: Mapping[tuple[int, str], float]
) -> tuple[WrongFix, ...]:
    """Those that are farther from the estimate than both are unsure."""
    found = []
    suspects = [(k, kind) for (k, kind), weight in weights.items() if weight < 1.0]
    for k, kind in suspects:
        residual, jacobian = _residual(priors[k], solution.trajectory.T_world_sensor[k], kind)
        marginal = solution.covariance(k)
        together = jacobian @ marginal @ jacobian.T + np.diag(priors[k].sigmas[KINDS[kind]] ** 2)
        squared = float(residual @ np.linalg.solve(together, residual))
        if squared > chdtri(len(residual), _RARE):
            found.append(WrongFix(k, kind, float(np.sqrt(squared))))
    return tuple(sorted(found, key=lambda fix: (fix.scan, fix.kind)))


def _too_many(wrong: Sequence[WrongFix], weights: Mapping[tuple[int, str], float]) -> bool:
    """Whether so many fixes of a kind seem wrong that rather the edges are."""
    return any(
        sum(fix.kind == kind for fix in wrong) > _MOST * sum(each == kind for _, each in weights) for kind in KINDS
    )


def _residual(prior: PosePrior, T: RigidTransform, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """How far a pose is from one kind of a prior, in the world's axes, and (k, 6) by the pose's body tangent."""
    R = T.rotation.as_matrix()
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = jacobian[3:, 3:] = R
    off = np.zeros(6)
    measured = measured_rotation(prior)
    left = T.rotation * measured.inv()
    turn = float(twist(left))
    if kind == "attitude":
        up, there = (rotation.inv().apply([0.0, 0.0, 1.0]) for rotation in (measured, T.rotation))
        off[:3] = T.rotation.apply(np.cross(there, up))
    off[2] = turn
    off[3:] = T.translation - prior.T_world_sensor.translation
    return off[KINDS[kind]], jacobian[KINDS[kind]]


def _kinds(prior: PosePrior) -> list[str]:
    return [kind for kind, numbers in KINDS.items() if np.isfinite(prior.sigmas[numbers]).all()]


def _weighed(prior: PosePrior, weights: Mapping[tuple[int, str], float], k: int) -> PosePrior:
    sigmas = prior.sigmas.copy()
    for kind in _kinds(prior):
        sigmas[KINDS[kind]] /= np.sqrt(weights[k, kind])
    return replace(prior, sigmas=sigmas)


def _without(prior: PosePrior, kinds: set[str]) -> PosePrior | None:
    """The prior without these kinds; None where nothing is left."""
    sigmas = prior.sigmas.copy()
    for kind in kinds:
        sigmas[KINDS[kind]] = np.inf
    return replace(prior, sigmas=sigmas) if np.isfinite(sigmas).any() else None
