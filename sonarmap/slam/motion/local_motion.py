"""How a vehicle moves at a time, by the steps before and behind: what it does varies little by little."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.geometry import rotated

# That steps in a row have nothing in common is assumed before any is seen, as firmly as so many of them would tell it.
_ASSUMED = 4.0
# Steps are never more alike than this.
_MOST_ALIKE = 0.99


@dataclass(frozen=True, slots=True)
class Step:
    """A registered step from scan k to k + 1."""

    k: int  # number of its first scan
    rate: np.ndarray  # (6,) rotation vector and translation in the first scan's axes, per unit of time [rad, m]
    covariance: np.ndarray  # (6, 6) of the rate, as the registration tells it

    @classmethod
    def of(cls, pair: RegisteredPair, times: np.ndarray) -> "Step":
        """Of a pair that has been registered; `times` (N,) are the scans'."""
        assert pair.registration is not None
        span, T = float(times[pair.j] - times[pair.i]), pair.registration.T_target_source
        return cls(pair.i, rate_of(T) / span, rotated(T.rotation, pair.registration.covariance) / span**2)


def rate_of(T: RigidTransform) -> np.ndarray:
    """(..., 6) rotation vector and translation [rad, m]."""
    return np.concatenate([T.rotation.as_rotvec(), T.translation], axis=-1)


def likeness(steps: Sequence[Step], varied: np.ndarray, surveys: np.ndarray) -> np.ndarray:
    """(6,) correlation of each number of ascending steps in a row, 0 to 0.99; `varied` (6,) is the rates' variance,
    `surveys` (N,) the number of each scan's survey."""
    rows = [(a, b) for a, b in pairwise(steps) if b.k == a.k + 1 and surveys[a.k] == surveys[b.k]]
    if not rows:
        return np.zeros(6)
    change = np.array([b.rate - a.rate for a, b in rows]) ** 2
    known = np.array([np.diag(a.covariance) + np.diag(b.covariance) for a, b in rows]) <= 2 * varied
    count = known.sum(axis=0)
    half = np.where(known, change, 0.0).sum(axis=0) / np.maximum(2 * count, 1)
    return count / (count + _ASSUMED) * np.clip(1 - half / varied, 0.0, _MOST_ALIKE)


def rates_by_others(
    steps: Sequence[Step],
    usual: np.ndarray,
    varied: np.ndarray,
    alike: np.ndarray,
    times: np.ndarray,
    surveys: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(N - 1, 6) the rates from every scan to the next, and their variances; each by all steps but the one itself.

    What the rates differ from the usual by is taken for Ornstein-Uhlenbeck processes, which steps measure that leave
    directions open, too. What is before a step is filtered forward, what is behind it backward, and both are combined
    (Fraser and Potter, DOI 10.1109/TAC.1969.1099196).

    Args:
        steps: ascending.
        usual, varied: (6,) mean and variance of the rates.
        alike: (6,) their correlation in steps in a row.
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
        behind = reversed(list(_filtered(rows[::-1], measured, varied, alike, middle)))
        for k, (mean_before, spread_before), (mean_behind, spread_behind) in zip(rows, before, behind, strict=True):
            a, b = np.linalg.inv(spread_before), np.linalg.inv(spread_behind)
            covariance = np.linalg.inv(a + b - np.diag(1 / varied))
            rates[k] += covariance @ (a @ mean_before + b @ mean_behind)
            variances[k] = np.diag(covariance)
    return rates, variances


def _filtered(
    rows: Sequence[int],
    measured: Mapping[int, tuple[np.ndarray, np.ndarray]],
    varied: np.ndarray,
    alike: np.ndarray,
    middle: np.ndarray,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Mean (6,) and covariance (6, 6) of what each row differs from the usual by, as the rows before it tell; `middle`
    are the times of all steps, in usual times between scans."""
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
