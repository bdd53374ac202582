"""Whether covariances and probabilities match the errors: sums over rows, and tables of them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import CONFIDENCE, DASH, Rate, column, grouped, known, right, where, wilson
from sonarmap.tools.lab.reproduce.table import Table

# Shares of the points in common between which pairs are drawn (from 5 % on), and shown
OVERLAPS = ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))
FREEDOM = 6  # degrees of it, of a transform
# Probabilities are looked at between these; the last holds both its ends.
PROBABILITIES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.0)


@dataclass(frozen=True, slots=True)
class CovarianceCheck:
    """Normalized squared errors compared with chi-squared with six degrees of freedom."""

    mean: float  # of the errors; 6 with a calibrated covariance, more with one that is too small
    median: float  # of the errors; 5.35 with a calibrated covariance; a few large errors move it less than the mean
    # low, high: between which the mean of as many draws lies in 95 of 100 cases
    low: float
    high: float
    inside: Rate  # how many lie in the covariance's own 95 % ellipsoid

    @property
    def verdict(self) -> str:
        """Of the mean."""
        if self.low <= self.mean <= self.high:
            return "within the interval"
        return "the covariance is too small" if self.mean > self.high else "the covariance is too large"


@dataclass(frozen=True, slots=True)
class Reliability:
    """Registrations whose probability lies between two values."""

    # low, high: the two
    low: float
    high: float
    predicted: float  # the mean of the probabilities
    right: Rate  # how many of the registrations are right


def shared(rows: Iterable[Row], low: float, high: float = 1.0) -> list[Row]:
    """The rows whose pairs share more than `low` and at most `high` of their points."""
    return [row for row in rows if low < float(row["shared"]) <= high]


def calibration(rows: Iterable[Row]) -> CovarianceCheck | None:
    """Of the rows that have a normalized squared error; None where none has."""
    nees = column(known(rows, "nees"), "nees")
    if not len(nees):
        return None
    tail = (1 - CONFIDENCE) / 2
    low, high = (float(chi2.ppf(q, FREEDOM * len(nees)) / len(nees)) for q in (tail, 1 - tail))
    inside = wilson(int((nees <= chi2.ppf(CONFIDENCE, FREEDOM)).sum()), len(nees))
    return CovarianceCheck(math.fsum(nees) / len(nees), float(np.median(nees)), low, high, inside)


def reliability(rows: Iterable[Row], bounds: Sequence[float] = PROBABILITIES) -> list[Reliability]:
    """Of the rows that have a probability, between each two bounds that hold any."""
    rated = known(rows, "probability")
    p, good = column(rated, "probability"), np.array([bool(row["right"]) for row in rated])
    bins = []
    for low, high in pairwise(bounds):
        chosen = (low <= p) & ((p < high) | ((high == bounds[-1]) & (p == high)))
        if count := int(chosen.sum()):
            bins.append(Reliability(low, high, math.fsum(p[chosen]) / count, wilson(int(good[chosen].sum()), count)))
    return bins


def calibration_table(yaw: Sequence[Row], free: Sequence[Row], methods: Sequence[str]) -> Table:
    """Normalized squared errors of right registrations: of ours by overlap, noise, scene and turn; of the others."""
    ours = right(where(yaw, method=OURS))
    cases: list[tuple[str, Sequence[Row]]] = [(f"{OURS}, any yaw", ours)] if OURS in methods else []
    if cases:
        cases += [(f"… {low:.0%}..{high:.0%} shared", shared(ours, low, high)) for low, high in OVERLAPS]
        cases += [(f"… σ² = {noise:g} m²", some) for (noise,), some in sorted(grouped(ours, "sigma2").items())]
        cases += [(f"… {scene}", some) for (scene,), some in grouped(ours, "scene").items()]
        cases += [("… accepted", where(ours, accepted=True))]
        cases += [(f"{OURS}, any rotation", right(where(free, method=OURS)))]
    cases += [(f"{name}, any yaw", right(where(yaw, method=name))) for name in methods if name != OURS]
    return Table(
        "Normalized squared errors of right registrations (calibrated covariance: mean 6, median 5.35, 95 % inside)",
        (
            *("registrations of", "number", "mean", "95 % interval of a calibrated mean", "median"),
            *("in the 95 % ellipsoid", "verdict on the mean"),
        ),
        tuple(_line(name, rows) for name, rows in cases if rows),
    )


def reliability_table(yaw: Sequence[Row], free: Sequence[Row]) -> Table:
    """The probability that ours reports, next to how often it is right."""
    cases = (("any yaw", where(yaw, method=OURS)), ("any rotation", where(free, method=OURS)))
    lines = [
        (
            words,
            f"{rated.low:g}..{rated.high:g}",
            f"{rated.predicted:.3f}",
            f"{rated.right.share:.3f}",
            str(rated.right),
        )
        for words, rows in cases
        for rated in reliability(rows)
    ]
    headings = ("pairs", "reported probability", "mean of these", "share right", "right, with 95 % interval")
    return Table(f"The probability that `{OURS}` reports, and how often it is right", headings, tuple(lines))


def _line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    check = calibration(rows)
    if check is None:
        return (name, str(len(rows)), *[DASH] * 5)
    inside = f"{check.inside.share:.1%} [{check.inside.low:.1%}..{check.inside.high:.1%}]"
    interval = f"{check.low:.2f}..{check.high:.2f}"
    return (name, str(check.inside.trials), f"{check.mean:.2f}", interval, f"{check.median:.2f}", inside, check.verdict)
