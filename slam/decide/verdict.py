"""What became of every pair of a survey: in sigmas, and in words."""

from collections.abc import Mapping, Sequence

import numpy as np

from slam.decide.hypothesis import Hypothesis
from slam.decide.judged import Judged, Key
from slam.graph.pose_graph import Solution
from slam.pair import Pair, Trial
from spectral.result import Registration


def account(
    trials: Sequence[Trial], judged: Sequence[Judged], taken: Mapping[Key, Judged], solution: Solution
) -> list[Pair]:
    """One row for every trial, in their order.

    Args:
        trials: what was tried.
        judged: all its answers but those of the chain, with what speaks for them.
        taken: those of them that were given to the optimizer.
        solution: what it made of them and the chain; its edges are what it kept.
    """
    kept = {(edge.i, edge.j): n for n, edge in enumerate(solution.graph.edges)}
    best = {(one.hypothesis.i, one.hypothesis.j): one for one in reversed(judged)} | dict(taken)
    part = {pose: number for number, members in enumerate(solution.graph.components) for pose in members}
    pairs = []
    for trial in trials:
        key, registration = (trial.i, trial.j), trial.attempt.registration
        one, n = best.get(key), kept.get(key)
        edge = None if n is None else solution.graph.edges[n]
        residual = float("nan")
        if n is not None:
            residual = float(solution.residuals[n])
        elif registration is not None and part[trial.i] == part[trial.j]:
            residual = _distance(solution, one.hypothesis if one else Hypothesis(trial.i, trial.j, 0, registration))
        pairs.append(
            Pair(
                i=trial.i,
                j=trial.j,
                role=trial.role,
                registration=registration,
                edge=edge,
                reason=_words(trial, one, key in taken, edge is not None, residual),
                predicted_overlap=trial.overlap,
                alike=trial.alike,
                agreeing=one.support.pairs - 1 if one else 0,
                sigmas_from_estimate=one.support.sigmas if one else float("nan"),
                residual=residual,
            )
        )
    return pairs


def _distance(solution: Solution, one: Hypothesis) -> float:
    return float("nan") if one.fault else solution.distance(one.i, one.j, one.registration)


def _words(trial: Trial, one: Judged | None, taken: bool, kept: bool, residual: float) -> str:
    registration = trial.attempt.registration
    if registration is None:
        return f"failed: {trial.attempt.failure}"
    if one is None:
        if fault := Hypothesis(trial.i, trial.j, 0, registration).fault:
            return f"failed: {fault}"
        if kept:
            return f"kept: {registration.reason or 'no reason given'}"
        if registration.accepted:
            return f"refused, inconsistent: the other pairs put it {residual:.1f} sigmas from there"
        return _refused(registration)
    if kept:
        return f"kept: {_agreement(one)}{_doubt(registration, one)}, {residual:.1f} sigmas from the final poses"
    if taken:
        return f"refused, inconsistent: the other pairs put it {residual:.1f} sigmas from there"
    if registration.accepted:
        return f"refused, inconsistent: {_agreement(one)}"
    return _refused(registration)


def _agreement(one: Judged) -> str:
    """What the chain and the other pairs say of it."""
    support = one.support
    others = f"{support.pairs - 1} other pairs agree with it" if support.pairs > 1 else "no other pair agrees with it"
    if np.isnan(support.sigmas):
        return f"{others} on how two parts lie to each other"
    if support.agrees and support.pairs == 1:
        return f"the chain agrees with it to {support.sigmas:.1f} sigmas"
    return f"{others}, {support.sigmas:.1f} sigmas from the chain"


def _doubt(registration: Registration, one: Judged) -> str:
    """Why it was taken though the registration did not say so."""
    if one.hypothesis.rank:
        return f", which is the registration's answer {one.hypothesis.rank + 1} by probability"
    return "" if registration.accepted else f", though the registration was not sure ({registration.probability:.0%})"


def _refused(registration: Registration) -> str:
    return f"refused by the registration: {registration.reason or 'no reason given'}"
