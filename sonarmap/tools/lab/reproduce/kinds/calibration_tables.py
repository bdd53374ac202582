"""Whether probabilities and covariances hold in every kind: as reported, and fitted to the other kinds alone."""

import math
from collections.abc import Sequence

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.calibration_tables import CovarianceCheck, calibration, reliability
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import NOTHING as DASH
from sonarmap.tools.lab.reproduce.evaluation.summary import right
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.kind_summary import WORDS, distinct, without_navigation, worst_first
from sonarmap.tools.lab.reproduce.kinds.refit_summary import refitted_nees, refitted_probabilities
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATION, NOTHING
from sonarmap.tools.lab.reproduce.kinds.tables import Line
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.table import Table, verdict

TENTHS = tuple(k / 10 for k in range(11))
MOST_ERROR = 0.04  # expected calibration error of the probability
INSIDE = (0.88, 0.99)  # share of the truths in the 95 % ellipsoid
_DRAWS = 1000


def expected_error(rows: Sequence[Row]) -> float:
    """The expected calibration error of the probability (Guo et al., ICML 2017, arXiv 1706.04599), ten equal bins.

    That is the mean, over registrations, of how far the mean probability of a bin is from the share right in it. NaN
    where no row has a probability.
    """
    bins = reliability(rows, TENTHS)
    count = sum(rated.right.trials for rated in bins)
    if not count:
        return math.nan
    return math.fsum(abs(rated.predicted - rated.share) * rated.right.trials for rated in bins) / count


def usual_error(rows: Sequence[Row]) -> float:
    """The mean expected calibration error if the rows' probabilities were exact: what so few registrations leave.

    NaN where no row has a probability.
    """
    p = np.array([float(row["probability"]) for row in rows if not math.isnan(float(row["probability"]))])
    if not len(p):
        return math.nan
    bins = np.minimum((p * (len(TENTHS) - 1)).astype(int), len(TENTHS) - 2)[:, None] == np.arange(len(TENTHS) - 1)
    right_less_p = (np.random.default_rng(0).uniform(size=(_DRAWS, len(p))) < p) - p
    return float(np.abs(right_less_p @ bins).sum(axis=1).mean() / len(p))


def calibration_requirements(rows: Sequence[Row]) -> list[Line]:
    """As measure, required, ours, verdict: as reported, then for a kind that had no part in the fit."""
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
    headings = (
        "kind",
        "registrations",
        "expected calibration error",
        "the same of an exact probability",
        "right, with a covariance",
        "truths in the 95 % ellipsoid",
        "mean nees",
        "median nees",
    )
    title = f"What `{OURS}` reports: its probability, and the normalized squared errors (nees) of what is right"
    return Table(title, headings, tuple(_reported(name, some) for name, some in groups if some))


def left_out_table(rows: Sequence[Row]) -> Table:
    """The same for fits that never saw the kind; no rows where there is no evidence to fit."""
    ours = without_navigation(where(rows, method=OURS))
    probabilities, nees = refitted_probabilities(ours), refitted_nees(where(ours, priors=NOTHING))
    lines = []
    for kind in (*worst_first(ours), None):
        rated, scaled = (some if kind is None else where(some, kind=kind) for some in (probabilities, nees))
        if rated or scaled:
            checked = calibration(scaled)
            lines.append(
                (
                    kind or "all kinds",
                    str(len(rated)),
                    _number(expected_error(rated)),
                    _number(usual_error(rated)),
                    str(len(scaled)),
                    *_check(checked),
                )
            )
    headings = (
        "kind left out of the fit",
        "registrations",
        "expected calibration error",
        "the same of an exact probability",
        "right, nothing known",
        "truths in the 95 % ellipsoid",
        "mean nees",
        "median nees",
    )
    return Table(
        "Probability and scale of the covariance, fitted to all kinds but one and tested on it", headings, tuple(lines)
    )


def _reported(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    checked = calibration(right(rows))
    errors = (_number(expected_error(rows)), _number(usual_error(rows)))
    return (name, str(len(rows)), *errors, str(checked.inside.trials if checked else 0), *_check(checked))


def _check(checked: CovarianceCheck | None) -> tuple[str, str, str]:
    if checked is None:
        return DASH, DASH, DASH
    inside = f"{checked.share:.1%} [{checked.inside.low:.1%}..{checked.inside.high:.1%}]".replace("%", " %")
    return inside, f"{checked.mean:.2f}", f"{checked.median:.2f}"


def _error_line(rows: Sequence[Row], words: str) -> list[Line]:
    scores = {kind: expected_error(where(rows, kind=kind)) for kind in distinct(rows, "kind")}
    scores = {kind: score for kind, score in scores.items() if not math.isnan(score)}
    if not scores:
        return []
    worst = max(scores, key=lambda kind: scores[kind])
    good = sum(score <= MOST_ERROR for score in scores.values())
    shown = f"{good} of {len(scores)} kinds; worst: {worst} {scores[worst]:.3f}"
    what = f"expected calibration error of the probability, {words}"
    return [(what, f"at most {MOST_ERROR:g} in each kind", shown, verdict(good == len(scores)))]


def _inside_line(rows: Sequence[Row], words: str) -> list[Line]:
    checks = {kind: calibration(where(rows, kind=kind)) for kind in distinct(rows, "kind")}
    shares = {kind: check.share for kind, check in checks.items() if check is not None}
    if not shares:
        return []
    low, high = INSIDE
    worst = max(shares, key=lambda kind: max(low - shares[kind], shares[kind] - high))
    good = sum(low <= share <= high for share in shares.values())
    shown = f"{good} of {len(shares)} kinds; worst: {worst} {100 * shares[worst]:.0f} %"
    required = f"{100 * low:.0f} to {100 * high:.0f} % in each kind"
    return [(f"truths in the 95 % ellipsoid, {words}", required, shown, verdict(good == len(shares)))]


def _number(value: float) -> str:
    return DASH if math.isnan(value) else f"{value:.3f}"
