"""A vehicle's local motion, predicted from the steps before and after, as motion changes gradually."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.geometry import rotated

_PRIOR_STEPS = 4.0  # weight of the assumption that consecutive steps are uncorrelated [steps]
_MAX_CORRELATION = 0.99  # of consecutive steps


@dataclass(frozen=True, slots=True)
class Step:
    """A registered step from scan k to k + 1."""

    k: int  # number of its first scan
    rate: np.ndarray  # (6,) rotation vector and translation in the first scan's axes, per unit of time [rad, m]
    covariance: np.ndarray  # (6, 6) of the rate, by the registration

    @classmethod
    def of(cls, pair: RegisteredPair, times: np.ndarray) -> "Step":
        """Of a registered pair; `times` (N,) are those of the scans."""
        assert pair.registration is not None
        span, T = float(times[pair.j] - times[pair.i]), pair.registration.T_target_source
        return cls(pair.i, rate_of(T) / span, rotated(T.rotation, pair.registration.covariance) / span**2)


def rate_of(T: RigidTransform) -> np.ndarray:
    """(..., 6) rotation vector and translation [rad, m]."""
    return np.concatenate([T.rotation.as_rotvec(), T.translation], axis=-1)


def likeness(steps: Sequence[Step], varied: np.ndarray, surveys: np.ndarray) -> np.ndarray:
    """(6,) correlation of each number of consecutive steps, 0 to 0.99; steps ascend, `varied` (6,) is the variance of
    their rates, `surveys` (N,) the number of each scan's survey."""
    rows = [(a, b) for a, b in pairwise(steps) if b.k == a.k + 1 and surveys[a.k] == surveys[b.k]]
    if not rows:
        return np.zeros(6)
    change = np.array([b.rate - a.rate for a, b in rows]) ** 2
    known = np.array([np.diag(a.covariance) + np.diag(b.covariance) for a, b in rows]) <= 2 * varied
    count = known.sum(axis=0)
    half = np.where(known, change, 0.0).sum(axis=0) / np.maximum(2 * count, 1)
    return count / (count + _PRIOR_STEPS) * np.clip(1 - half / varied, 0.0, _MAX_CORRELATION)


def rates_by_others(
    steps: Sequence[Step],
    usual: np.ndarray,
    varied: np.ndarray,
    alike: np.ndarray,
    times: np.ndarray,
    surveys: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(N - 1, 6) rates from every scan to the next, and their variances; each predicted from all other steps.

    The deviations of rates from the usual one are Ornstein-Uhlenbeck processes, measured by the steps, also by those
    with unconstrained directions. A forward filter over the steps before and a backward filter over the steps after are
    combined (Fraser and Potter, DOI 10.1109/TAC.1969.1099196).

    Args:
        steps: ascending.
        usual, varied: (6,) mean and variance of the rates.
        alike: (6,) their correlation between consecutive steps.
        times: (N,) of the scans, ascending within a survey.
        surveys: (N,) the number of each scan's survey.
    """
    count, gaps = len(times) - 1, np.diff(times)
    measured = {step.k: (step.rate - usual, step.covariance) for step in steps}
    rates, variances = np.tile(usual, (count, 1)), np.tile(varied, (count, 1))
    borders = np.flatnonzero(np.diff(surveys)).tolist()
    between = gaps[np.diff(surveys) == 0]
    middle = (times[1:] + times[:-1]) / 2 / (np.median(between) if len(between) else 1.0)
    for first, last in zip([0, *(k + 1 for k in borders)], [*borders, count], strict=True):
        rows = range(first, last)
        before = _filtered(rows, measured, varied, alike, middle)
        after = reversed(list(_filtered(rows[::-1], measured, varied, alike, middle)))
        for k, (mean_before, spread_before), (mean_after, spread_after) in zip(rows, before, after, strict=True):
            a, b = np.linalg.inv(spread_before), np.linalg.inv(spread_after)
            covariance = np.linalg.inv(a + b - np.diag(1 / varied))
            rates[k] += covariance @ (a @ mean_before + b @ mean_after)
            variances[k] = np.diag(covariance)
    return rates, variances


def _filtered(
    rows: Sequence[int],
    measured: Mapping[int, tuple[np.ndarray, np.ndarray]],
    varied: np.ndarray,
    alike: np.ndarray,
    middle: np.ndarray,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Mean (6,) and covariance (6, 6) of each row's deviation from the usual rate, predicted from the rows before it;
    `middle` are the mean times of all steps [median intervals]."""
    mean, spread = np.zeros(6), np.diag(varied)
    for n, k in enumerate(rows):
        if n:
            decay = alike ** abs(middle[k] - middle[rows[n - 1]])
            mean, spread = decay * mean, np.outer(decay, decay) * spread + np.diag((1 - decay**2) * varied)
        yield mean, spread
        if k in measured:
            rate, covariance = measured[k]
            gain = np.linalg.solve(spread + covariance, spread).T
            mean, spread = mean + gain @ (rate - mean), spread - gain @ spread
            spread = (spread + spread.T) / 2
