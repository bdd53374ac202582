"""Rows of an experiment: those that hold certain values, and counts, shares and medians of them."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from scipy.stats import binomtest

from sonarmap.tools.lab.reproduce.experiment import Row

CONFIDENCE = 0.95
DASH = "–"  # for what there is not


def where(rows: Iterable[Row], **values: object) -> list[Row]:
    """The rows that hold these values."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def grouped(rows: Iterable[Row], *names: str) -> dict[tuple, list[Row]]:
    """The rows by what they hold in these columns, in the order of the rows."""
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups


def by_method(
    rows: Sequence[Row], methods: Iterable[str], column: str = "method"
) -> list[tuple[tuple[str, ...], list[Row]]]:
    """The lines of a table: each method's (or system's) name and rows."""
    return [((method,), where(rows, **{column: method})) for method in methods]


def for_each(
    name: str, values: Iterable[Any], cell: Callable[[list[Row]], str]
) -> dict[str, Callable[[list[Row]], str]]:
    """The columns of a table: for each value the cell of those rows that hold it in the column `name`."""
    return {str(value): lambda some, value=value: cell(where(some, **{name: value})) for value in values}


def distinct(rows: Iterable[Row], name: str) -> list[str]:
    """The values of a column as text, in the order of the rows."""
    return list(dict.fromkeys(str(row[name]) for row in rows))


def variants(rows: Iterable[Row], known: str) -> list[tuple[str, str]]:
    """The methods, each with everything of the column `known`, in order; those of one method together."""
    pairs = dict.fromkeys((str(row["method"]), str(row[known])) for row in rows)
    methods = list(dict.fromkeys(method for method, _ in pairs))
    return sorted(pairs, key=lambda pair: methods.index(pair[0]))


def column(rows: Iterable[Row], name: str) -> np.ndarray:
    """(N,) float64 of the rows."""
    return np.array([float(row[name]) for row in rows])


def known(rows: Iterable[Row], name: str) -> list[Row]:
    """The rows whose value in a column is not NaN."""
    return [row for row in rows if not math.isnan(float(row[name]))]


def right(rows: Iterable[Row]) -> list[Row]:
    """Those that are right."""
    return [row for row in rows if row["right"]]


def wrong(rows: Iterable[Row]) -> list[Row]:
    """Those that are not."""
    return [row for row in rows if not row["right"]]


def accepted(rows: Iterable[Row]) -> list[Row]:
    """Those that the method accepts."""
    return [row for row in rows if row["accepted"]]


def refused(rows: Iterable[Row]) -> list[Row]:
    """Those that it refuses."""
    return [row for row in rows if not row["accepted"]]


def last_right(rows: Iterable[Row], over: str, *series: str) -> list[int]:
    """Of each series, in the order of the columns that name it, the last step that is right with all before it.

    -1 where the first is wrong. `over` is the column of the steps.
    """
    ends = []
    for _, some in sorted(grouped(rows, *series).items()):
        failed = [int(row[over]) for row in wrong(some)]
        ends.append(min(failed, default=1 + max(int(row[over]) for row in some)) - 1)
    return ends


def step_name(step: int) -> str:
    """Of Table 1's scans and of what follows them, as in "S3"; "none" below 0."""
    return f"S{step}" if step >= 0 else "none"


@dataclass(frozen=True, slots=True)
class Rate:
    """Successes among trials, with Wilson's 95 % interval (DOI 10.1080/01621459.1927.10502953)."""

    # successes, trials: 0 <= successes <= trials, at least one trial
    successes: int
    trials: int
    # low, high: the interval of the rate, 0..1
    low: float
    high: float

    @property
    def share(self) -> float:
        """0..1."""
        return self.successes / self.trials

    def __str__(self) -> str:
        return f"{self.successes}/{self.trials} [{self.low:.2f}..{self.high:.2f}]"


def wilson(successes: int, trials: int) -> Rate:
    """The rate of `successes` among at least one trial, with its interval."""
    interval = binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    return Rate(successes, trials, float(interval.low), float(interval.high))


def rate(hits: Sequence[Row], rows: Sequence[Row]) -> str:
    """How many of the rows are hits, as in "3/4 [0.30..0.95]"; a dash where there are none."""
    return str(wilson(len(hits), len(rows))) if rows else DASH


def percent(hits: Sequence[Row], rows: Sequence[Row]) -> str:
    """The same in percent, as in "75 % [30..95]"."""
    if not rows:
        return DASH
    share = wilson(len(hits), len(rows))
    return f"{in_percent(share.share)} [{100 * share.low:.0f}..{100 * share.high:.0f}]"


def in_percent(share: float, digits: int = 0) -> str:
    """As in "75 %"."""
    return f"{100 * share:.{digits}f} %"


def middle(rows: Sequence[Row], name: str) -> float:
    """The median of a column, NaN where there are no rows."""
    return median(float(row[name]) for row in rows) if rows else math.nan


def number(value: float, digits: int) -> str:
    """With so many decimals; a dash for NaN."""
    return DASH if math.isnan(value) else f"{value:.{digits}f}"


def expect(hits: Sequence[Row], rows: Sequence[Row], what: str) -> str:
    """What a share means for a user, as in "expect 7 of 100 accepted registrations to be wrong"."""
    return f"expect {100 * len(hits) / len(rows):.0f} of 100 {what}" if rows else DASH
