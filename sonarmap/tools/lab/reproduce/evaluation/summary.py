"""Shares and medians over rows of the evaluation."""

from collections.abc import Iterable, Sequence
from statistics import median

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.rate import wilson

NOTHING = "–"

# Shares of the points in common between which pairs are drawn (from 5 % on), and shown
OVERLAPS = ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))


def shared(rows: Iterable[Row], low: float, high: float = 1.0) -> list[Row]:
    """The rows whose pairs share more than `low` and at most `high` of their points."""
    return [row for row in rows if low < float(row["shared"]) <= high]


def rate(hits: Sequence[Row], rows: Sequence[Row]) -> str:
    """How many of the rows are hits, as in "3/4 [0.30..0.95]"; a dash where there are none."""
    return str(wilson(len(hits), len(rows))) if rows else NOTHING


def percent(hits: Sequence[Row], rows: Sequence[Row]) -> str:
    """The same in percent, with Wilson's interval, as in "75 % [30..95]"."""
    if not rows:
        return NOTHING
    share = wilson(len(hits), len(rows))
    return f"{share.successes / share.trials:.0%} [{100 * share.low:.0f}..{100 * share.high:.0f}]".replace("%", " %")


def right(rows: Iterable[Row]) -> list[Row]:
    """Those that are right."""
    return [row for row in rows if row["right"]]


def accepted(rows: Iterable[Row]) -> list[Row]:
    """Those that the method accepts."""
    return [row for row in rows if row["accepted"]]


def wrong(rows: Iterable[Row]) -> list[Row]:
    """Those that are not right."""
    return [row for row in rows if not row["right"]]


def refused(rows: Iterable[Row]) -> list[Row]:
    """Those that the method refuses."""
    return [row for row in rows if not row["accepted"]]


def accurate(rows: Iterable[Row]) -> list[Row]:
    """Right registrations of pairs that share more than half, at noise up to the paper's first."""
    return [row for row in shared(right(rows), 0.5) if float(row["sigma2"]) <= 1]


def middle(rows: Sequence[Row], key: str) -> float:
    """The median of a column, NaN where there are no rows."""
    return median(float(row[key]) for row in rows) if rows else float("nan")


def last_right(rows: Sequence[Row]) -> list[int]:
    """Per scene and seed the last step that is right with all before it; -1 where S0 is wrong. Rows of one noise and
    method."""
    ends: dict[object, int] = {}
    for row in sorted(rows, key=lambda row: int(row["step"])):
        series, step = (row["scene"], row["seed"]), int(row["step"])
        ends.setdefault(series, -1)
        if row["right"] and ends[series] == step - 1:
            ends[series] = step
    return list(ends.values())
