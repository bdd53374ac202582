"""The probability and the scale of the covariance fitted anew, from rows of all kinds of scans but one.

Both are fitted from the evidence that rows of ours have in columns: `evidence_p_...` decide the probability,
`evidence_c_...` the variance. So what is judged on the kind left out is whether such evidence means the same for a kind
that had no part in the fit.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from sonarmap.tools.lab.reproduce.experiment import Row

FREEDOM = 6  # of a transform
RIDGE = 1e-3  # weight of the squared weights in the mean loss, of columns with deviation 1
PROBABILITY, VARIANCE = "evidence_p_", "evidence_c_"


@dataclass(frozen=True, slots=True)
class Linear:
    """A linear function of K columns.

    Attributes:
        mean, scale: (K,) of the columns where it was fitted.
        weights: (K + 1,) of the columns less their mean over their scale, and a constant.
    """

    mean: np.ndarray
    scale: np.ndarray
    weights: np.ndarray

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """(N,) its values for (N, K) columns."""
        return _with_constant((columns - self.mean) / self.scale) @ self.weights


def fit_probability(columns: np.ndarray, right: np.ndarray) -> Linear:
    """Logistic regression: the log odds of being right.

    Args:
        columns: (N, K).
        right: (N,) bool.
    """
    signs = np.where(right, 1.0, -1.0)

    def loss(x: np.ndarray, weights: np.ndarray) -> tuple[float, np.ndarray]:
        margins = signs * (x @ weights)
        return float(np.logaddexp(0.0, -margins).mean()), -x.T @ (signs * expit(-margins)) / len(x)

    return _fit(columns, loss)


def fit_variance(columns: np.ndarray, nees: np.ndarray) -> Linear:
    """The logarithm of what all variances are to be multiplied by, by maximum likelihood of normal errors.

    With variances times v the normalized squared error e becomes e / v, and -log likelihood is (e / v + 6 log v) / 2
    but for a constant.

    Args:
        columns: (N, K).
        nees: (N,) normalized squared errors with six degrees of freedom.
    """

    def loss(x: np.ndarray, weights: np.ndarray) -> tuple[float, np.ndarray]:
        log_v = x @ weights
        scaled = nees * np.exp(-np.clip(log_v, -50.0, 50.0))
        return float((scaled + FREEDOM * log_v).mean() / 2), x.T @ (FREEDOM - scaled) / (2 * len(x))

    return _fit(columns, loss, math.log(float(nees.mean()) / FREEDOM))


def refitted_probabilities(rows: Sequence[Row]) -> list[Row]:
    """The rows that have evidence of the probability, each with the one fitted to the other kinds' rows."""
    known, columns = _columns(rows, PROBABILITY)
    right = np.array([bool(row["right"]) for row in known])
    return _left_out(
        known, lambda fit, out: expit(fit_probability(columns[fit], right[fit])(columns[out])), "probability"
    )


def refitted_nees(rows: Sequence[Row]) -> list[Row]:
    """The rows that have evidence of the variance, each with its nees by a scale fitted to the other kinds' rows.

    Only right registrations without priors count: a prior's part of a covariance has no scale to fit.
    """
    some = [row for row in rows if row["right"] and not math.isnan(float(row["nees"]))]
    known, columns = _columns(some, VARIANCE)
    nees = np.array([float(row["nees"]) for row in known])
    return _left_out(
        known, lambda fit, out: nees[out] * np.exp(-fit_variance(columns[fit], nees[fit])(columns[out])), "nees"
    )


def _left_out(rows: Sequence[Row], predict: Callable[[np.ndarray, np.ndarray], np.ndarray], name: str) -> list[Row]:
    """The rows, a column replaced by what `predict` makes of it, for each kind's rows, from the others'; none where
    there are not two kinds."""
    kinds = np.array([str(row["kind"]) for row in rows])
    if len(set(kinds)) < 2:
        return []
    values = np.empty(len(rows))
    for kind in dict.fromkeys(kinds):
        values[kinds == kind] = predict(kinds != kind, kinds == kind)
    return [{**row, name: float(value)} for row, value in zip(rows, values, strict=True)]


def _columns(rows: Sequence[Row], prefix: str) -> tuple[list[Row], np.ndarray]:
    """The rows whose columns of this prefix are all finite, and these columns, (N, K); no rows where K is 0."""
    names = sorted({key for row in rows for key in row if key.startswith(prefix)})
    known = [row for row in rows if names and all(math.isfinite(float(row.get(name, math.nan))) for name in names)]
    return known, np.array([[float(row[name]) for name in names] for row in known]).reshape(len(known), len(names))


def _fit(
    columns: np.ndarray, loss: Callable[[np.ndarray, np.ndarray], tuple[float, np.ndarray]], constant: float = 0.0
) -> Linear:
    """The weights with the least loss, which is convex, searched from this constant alone; a small weight on their
    squares keeps them finite."""
    mean, deviation = columns.mean(axis=0), columns.std(axis=0)
    scale = np.where(deviation > 0, deviation, 1.0)
    x = _with_constant((columns - mean) / scale)
    ridge = np.full(x.shape[1], RIDGE)
    ridge[-1] = 0.0

    def regularized(weights: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = loss(x, weights)
        return value + float(ridge @ weights**2) / 2, gradient + ridge * weights

    start = np.append(np.zeros(columns.shape[1]), constant)
    found = minimize(regularized, start, jac=True, method="BFGS", options={"gtol": 1e-8})
    return Linear(mean, scale, found.x)


def _with_constant(columns: np.ndarray) -> np.ndarray:
    return np.column_stack([columns, np.ones(len(columns))])
