"""Some pairs of a survey registered without priors, as a test of the priors that will bound other pairs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.geometry import measured_rotation, rotated
from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.scan import PosePrior, Scan

_PAIRS = 8  # spread evenly over the survey, and as many between which the vehicle turns most
LEAST_PAIRS = 6  # smallest number of pairs from which a scale of errors is estimated
# By kind: the numbers of a prior to use, and those of the pair's six differences to test, which are the last residuals.
_KINDS = {"attitude": ([0, 1], [0, 1]), "heading": ([0, 1, 2], [2]), "depth": ([0, 1, 5], [5])}
_UNDERESTIMATED = 2.0  # ratio of errors to stated sigmas from which these are scaled


def register_freely(runner: PairRunner, scans: Sequence[Scan], surveys: np.ndarray) -> list[RegisteredPair]:
    """Consecutive pairs with priors, evenly spread and where the vehicle turns most, registered without the priors;
    none if there are fewer than `LEAST_PAIRS`. `surveys` are the (N,) numbers of the scans' surveys."""
    pairs = _chosen(scans, surveys)
    if len(pairs) < LEAST_PAIRS:
        return []
    ends = sorted({k for scans_of in pairs for k in scans_of})
    number = {k: len(scans) + n for n, k in enumerate(ends)}
    free = runner.beside([replace(scans[k], prior=None) for k in ends], ends)
    registered = free.register([Candidate(number[i], number[j], "sequential") for i, j in pairs])
    back = {number[k]: k for k in ends}
    return [pair.renumbered(back) for pair in registered if pair.accepted]


def _chosen(scans: Sequence[Scan], surveys: np.ndarray) -> list[tuple[int, int]]:
    turns: list[float] = []
    pairs: list[tuple[int, int]] = []
    for k in range(len(scans) - 1):
        first, second = scans[k].prior, scans[k + 1].prior
        if first is None or second is None or surveys[k] != surveys[k + 1]:
            continue
        pairs.append((k, k + 1))
        turns.append(float((first.T_world_sensor.rotation.inv() * second.T_world_sensor.rotation).magnitude()))
    most: list[int] = np.argsort(turns)[::-1][:_PAIRS].tolist()
    evenly: list[int] = np.linspace(0, len(pairs) - 1, _PAIRS).round().astype(int).tolist() if pairs else []
    return [pairs[k] for k in sorted({*most, *evenly})]


def errors_shown(pairs: Sequence[RegisteredPair], priors: Mapping[int, PosePrior]) -> dict[str, float]:
    """Ratios of actual to stated errors of attitudes, headings and depths, by kind, where clearly above 1.

    They compare the median squared difference between registrations and priors with that of chi-squared.
    """
    ratios: dict[str, float] = {}
    for kind, (measured, numbers) in _KINDS.items():
        squared = [d for pair in pairs if (d := _squared_distance(pair, priors, measured, numbers)) is not None]
        expected = chi_squared(0.5, len(numbers))
        ratio = float(np.sqrt(np.median(squared) / expected)) if len(squared) >= LEAST_PAIRS else 1.0
        if ratio >= _UNDERESTIMATED:
            ratios[kind] = ratio
    return ratios


def _squared_distance(
    pair: RegisteredPair, priors: Mapping[int, PosePrior], measured: list[int], numbers: list[int]
) -> float | None:
    """Chi-squared of a registration against both scans' priors in these numbers; None without either."""
    registration = pair.registration
    if registration is None or not all(np.isfinite(priors[k].sigmas[measured]).all() for k in pair.scans):
        return None
    both = RelativePrior(*(_alone(priors[k], measured) for k in pair.scans))
    R, last = registration.T_target_source.rotation, slice(-len(numbers), None)
    off = both.at(R, registration.T_target_source.translation)
    residual, covariance = off.residual[0, last], off.covariance[0, last, last]
    R_world_source = measured_rotation(both.target) * R
    covariance = covariance + rotated(R_world_source, registration.covariance)[np.ix_(numbers, numbers)]
    return float(residual @ np.linalg.solve(covariance, residual))


def _alone(prior: PosePrior, measured: list[int]) -> PosePrior:
    sigmas = np.full(6, np.inf)
    sigmas[measured] = prior.sigmas[measured]
    return replace(prior, sigmas=sigmas)
