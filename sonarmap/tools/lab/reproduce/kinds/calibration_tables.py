"""Whether probabilities and covariances hold in every kind: as reported, and fitted to the other kinds alone."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from sonarmap.tools.lab.reproduce.beside import Line
from sonarmap.tools.lab.reproduce.calibration_tables import FREEDOM, CovarianceCheck, calibration, reliability
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATION, NOTHING
from sonarmap.tools.lab.reproduce.kinds.tables import WORDS, without_navigation, worst_first
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import (
    CONFIDENCE,
    DASH,
    column,
    distinct,
    grouped,
    in_percent,
    known,
    number,
    right,
    where,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of

TENTHS = tuple(k / 10 for k in range(11))
RIDGE = 1e-3  # weight of the squared weights in the mean loss, of columns with deviation 1
PROBABILITY, VARIANCE = "evidence_p_", "evidence_c_"
_DRAWS = 1000


def expected_error(rows: Sequence[Row]) -> float:
    """The expected calibration error of the probability (Guo et al., ICML 2017, arXiv 1706.04599), ten equal bins.

    That is the mean, over registrations, of how far the mean probability of a bin is from the share right in it. NaN
    where no row has a probability.
    """
    bins = reliability(rows, TENTHS)
    count = sum(rated.right.trials for rated in bins)
    off = math.fsum(abs(rated.predicted - rated.right.share) * rated.right.trials for rated in bins)
    return off / count if count else math.nan


def usual_error(rows: Sequence[Row]) -> float:
    """The mean expected calibration error if the rows' probabilities were exact: what so few registrations leave.

    NaN where no row has a probability.
    """
    p = column(known(rows, "probability"), "probability")
    if not len(p):
        return math.nan
    bins = np.minimum((p * (len(TENTHS) - 1)).astype(int), len(TENTHS) - 2)[:, None] == np.arange(len(TENTHS) - 1)
    right_less_p = (np.random.default_rng(0).uniform(size=(_DRAWS, len(p))) < p) - p
    return float(np.abs(right_less_p @ bins).sum(axis=1).mean() / len(p))


def calibration_beside(rows: Sequence[Row]) -> list[Line]:
    """As reported, then for a kind that had no part in the fit; the other methods report neither."""
    ours = without_navigation(where(rows, method=OURS))
    lines: list[Line] = []
    probabilities, nees = refitted_probabilities(ours), refitted_nees(where(ours, priors=NOTHING))
    for words, rated, scaled in (("as reported", ours, ours), ("fitted to the other kinds alone", probabilities, nees)):
        lines += _error_line(rated, words) + _inside_line(right(scaled), words)
    return lines


def reported_table(rows: Sequence[Row]) -> Table:
    """The probability and the covariance that ours reports, kind by kind, the worst first."""
    ours = where(rows, method=OURS)
    plain = without_navigation(ours)
    groups = [(kind, where(plain, kind=kind)) for kind in worst_first(plain)]
    groups += [(f"all kinds, known: {WORDS[known]}", where(plain, priors=known)) for known in distinct(plain, "priors")]
    groups += [("all kinds", plain), ("swath, known: navigation", where(ours, priors=NAVIGATION))]
    title = f"What `{OURS}` reports: its probability, and the normalized squared errors (nees) of what is right"
    checked = [((name,), (some, known(right(some), "nees"))) for name, some in groups if some]
    return table_of(title, ("kind",), checked, _columns_of("right, with a covariance"))


def left_out_table(rows: Sequence[Row]) -> Table:
    """The same for fits that never saw the kind; no rows where there is no evidence to fit."""
    ours = without_navigation(where(rows, method=OURS))
    probabilities, nees = refitted_probabilities(ours), refitted_nees(where(ours, priors=NOTHING))
    groups = [((kind,), (where(probabilities, kind=kind), where(nees, kind=kind))) for kind in worst_first(ours)]
    checked = [group for group in (*groups, (("all kinds",), (probabilities, nees))) if any(group[1])]
    title = "Probability and scale of the covariance, fitted to all kinds but one and tested on it"
    return table_of(title, ("kind left out of the fit",), checked, _columns_of("right, nothing known"))


def _columns_of(counted: str) -> dict[str, Callable[[tuple[list[Row], list[Row]]], str]]:
    """Of the rows whose probability is checked, and of those whose normalized squared error is."""

    def of_nees(cell: Callable[[CovarianceCheck], str]) -> Callable[[tuple[list[Row], list[Row]]], str]:
        return lambda some: DASH if (checked := calibration(some[1])) is None else cell(checked)

    def inside(checked: CovarianceCheck) -> str:
        share, low, high = (in_percent(x, 1) for x in (checked.inside.share, checked.inside.low, checked.inside.high))
        return f"{share} [{low}..{high}]"

    return {
        "registrations": lambda some: str(len(some[0])),
        "expected calibration error": lambda some: number(expected_error(some[0]), 3),
        "the same of an exact probability": lambda some: number(usual_error(some[0]), 3),
        counted: lambda some: str(len(some[1])),
        "truths in the 95 % ellipsoid": of_nees(inside),
        "mean nees": of_nees(lambda checked: f"{checked.mean:.2f}"),
        "median nees": of_nees(lambda checked: f"{checked.median:.2f}"),
    }


def _error_line(rows: Sequence[Row], words: str) -> list[Line]:
    scores = {str(kind): expected_error(some) for (kind,), some in grouped(known(rows, "probability"), "kind").items()}
    if not scores:
        return []
    worst, whole = max(scores, key=lambda kind: scores[kind]), expected_error(rows)
    shown = f"{whole:.3f}; worst kind: {worst} {scores[worst]:.3f}"
    follows = f"probabilities are off by {whole:.2f} on average, and by {scores[worst]:.2f} in the worst kind"
    return [(f"expected calibration error of the probability, {words}", shown, DASH, follows)]


def _inside_line(rows: Sequence[Row], words: str) -> list[Line]:
    checks = {kind: calibration(some) for (kind,), some in grouped(rows, "kind").items()}
    shares = {kind: check.inside.share for kind, check in checks.items() if check is not None}
    whole = calibration(rows)
    if whole is None:
        return []
    worst = max(shares, key=lambda kind: abs(shares[kind] - CONFIDENCE))
    shown = f"{in_percent(whole.inside.share)}; farthest from 95 %: {worst} {in_percent(shares[worst])}"
    follows = f"expect {100 * whole.inside.share:.0f} of 100 truths in the 95 % ellipsoid"
    return [(f"truths in the 95 % ellipsoid, {words}", shown, DASH, follows)]


Linear = Callable[[np.ndarray], np.ndarray]  # (N,) values of a linear function for (N, K) columns


def fit_probability(columns: np.ndarray, right: np.ndarray) -> Linear:
    """The log odds of being `right`, (N,) bool, by logistic regression on (N, K) columns."""
    signs = np.where(right, 1.0, -1.0)

    def loss(x: np.ndarray, weights: np.ndarray) -> tuple[float, np.ndarray]:
        margins = signs * (x @ weights)
        return float(np.logaddexp(0.0, -margins).mean()), -x.T @ (signs * expit(-margins)) / len(x)

    return _fit(columns, loss)


def fit_variance(columns: np.ndarray, nees: np.ndarray) -> Linear:
    """The logarithm of what all variances are to be multiplied by, by maximum likelihood of normal errors.

    With variances times v the normalized squared error e becomes e / v, and -log likelihood is (e / v + 6 log v) / 2
    but for a constant. `columns` are (N, K); `nees` are (N,), with six degrees of freedom.
    """

    def loss(x: np.ndarray, weights: np.ndarray) -> tuple[float, np.ndarray]:
        log_v = x @ weights
        scaled = nees * np.exp(-np.clip(log_v, -50.0, 50.0))
        return float((scaled + FREEDOM * log_v).mean() / 2), x.T @ (FREEDOM - scaled) / (2 * len(x))

    return _fit(columns, loss, math.log(float(nees.mean()) / FREEDOM))


def _fit(
    columns: np.ndarray, loss: Callable[[np.ndarray, np.ndarray], tuple[float, np.ndarray]], constant: float = 0.0
) -> Linear:
    """The function with the least loss, which is convex in its weights, searched from this constant alone; a small
    weight on their squares keeps them finite. Columns are taken with mean 0 and deviation 1."""
    mean, deviation = columns.mean(axis=0), columns.std(axis=0)
    scale = np.where(deviation > 0, deviation, 1.0)

    def scaled(columns: np.ndarray) -> np.ndarray:
        return np.column_stack([(columns - mean) / scale, np.ones(len(columns))])

    x = scaled(columns)
    ridge = np.append(np.full(columns.shape[1], RIDGE), 0.0)

    def regularized(weights: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = loss(x, weights)
        return value + float(ridge @ weights**2) / 2, gradient + ridge * weights

    start = np.append(np.zeros(columns.shape[1]), constant)
    weights = minimize(regularized, start, jac=True, method="BFGS", options={"gtol": 1e-8}).x
    return lambda columns: scaled(columns) @ weights


def refitted_probabilities(rows: Sequence[Row]) -> list[Row]:
    """The rows that have evidence of the probability, each with the one fitted to the other kinds' rows."""
    some, columns = _columns(rows, PROBABILITY)
    right = np.array([bool(row["right"]) for row in some])
    return _left_out(
        some, lambda fit, out: expit(fit_probability(columns[fit], right[fit])(columns[out])), "probability"
    )


def refitted_nees(rows: Sequence[Row]) -> list[Row]:
    """The rows that have evidence of the variance, each with its nees by a scale fitted to the other kinds' rows.

    Only right registrations without priors count: a prior's part of a covariance has no scale to fit.
    """
    some, columns = _columns(known(right(rows), "nees"), VARIANCE)
    nees = column(some, "nees")
    return _left_out(
        some, lambda fit, out: nees[out] * np.exp(-fit_variance(columns[fit], nees[fit])(columns[out])), "nees"
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
    some = [row for row in rows if names and all(math.isfinite(float(row.get(name, math.nan))) for name in names)]
    return some, np.array([[float(row[name]) for name in names] for row in some]).reshape(len(some), len(names))
