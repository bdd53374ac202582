"""Whether probabilities and covariances hold in every kind: as they are reported."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sonarmap.tools.lab.reproduce.beside import Line
from sonarmap.tools.lab.reproduce.calibration_tables import CovarianceCheck, calibration, reliability
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATION
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
    """As reported; the other methods report neither. Kinds left out of the fit are looked at by `reproduce judge`."""
    ours = without_navigation(where(rows, method=OURS))
    return _error_line(ours) + _inside_line(right(ours))


def reported_table(rows: Sequence[Row]) -> Table:
    """The probability and the covariance that ours reports, kind by kind, the worst first."""
    ours = where(rows, method=OURS)
    plain = without_navigation(ours)
    groups = [(kind, where(plain, kind=kind)) for kind in worst_first(plain)]
    groups += [(f"all kinds, known: {WORDS[known]}", where(plain, priors=known)) for known in distinct(plain, "priors")]
    groups += [("all kinds", plain), ("swath, known: navigation", where(ours, priors=NAVIGATION))]
    title = f"What `{OURS}` reports: its probability, and the normalized squared errors (nees) of what is right"
    checked = [((name,), (some, known(right(some), "nees"))) for name, some in groups if some]
    return table_of(title, ("kind",), checked, _COLUMNS)


# The rows whose probability is checked, and those whose normalized squared error is
_Checked = tuple[list[Row], list[Row]]


def _of_nees(cell: Callable[[CovarianceCheck], str]) -> Callable[[_Checked], str]:
    return lambda some: DASH if (checked := calibration(some[1])) is None else cell(checked)


def _inside(checked: CovarianceCheck) -> str:
    share, low, high = (in_percent(x, 1) for x in (checked.inside.share, checked.inside.low, checked.inside.high))
    return f"{share} [{low}..{high}]"


_COLUMNS: Mapping[str, Callable[[_Checked], str]] = {
    "registrations": lambda some: str(len(some[0])),
    "expected calibration error": lambda some: number(expected_error(some[0]), 3),
    "the same of an exact probability": lambda some: number(usual_error(some[0]), 3),
    "right, with a covariance": lambda some: str(len(some[1])),
    "truths in the 95 % ellipsoid": _of_nees(_inside),
    "mean nees": _of_nees(lambda checked: f"{checked.mean:.2f}"),
    "median nees": _of_nees(lambda checked: f"{checked.median:.2f}"),
}


def _error_line(rows: Sequence[Row]) -> list[Line]:
    scores = {str(kind): expected_error(some) for (kind,), some in grouped(known(rows, "probability"), "kind").items()}
    if not scores:
        return []
    worst, whole = max(scores, key=lambda kind: scores[kind]), expected_error(rows)
    shown = f"{whole:.3f}; worst kind: {worst} {scores[worst]:.3f}"
    follows = f"probabilities are off by {whole:.2f} on average, and by {scores[worst]:.2f} in the worst kind"
    return [("expected calibration error of the probability, as reported", shown, DASH, follows)]


def _inside_line(rows: Sequence[Row]) -> list[Line]:
    checks = {kind: calibration(some) for (kind,), some in grouped(rows, "kind").items()}
    shares = {kind: check.inside.share for kind, check in checks.items() if check is not None}
    whole = calibration(rows)
    if whole is None:
        return []
    worst = max(shares, key=lambda kind: abs(shares[kind] - CONFIDENCE))
    shown = f"{in_percent(whole.inside.share)}; farthest from 95 %: {worst} {in_percent(shares[worst])}"
    follows = f"expect {100 * whole.inside.share:.0f} of 100 truths in the 95 % ellipsoid"
    return [("truths in the 95 % ellipsoid, as reported", shown, DASH, follows)]
