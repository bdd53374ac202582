"""The time to register a pair, in words and tables."""

from collections.abc import Iterable, Sequence
from statistics import median

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import (
    DASH,
    accepted,
    by_method,
    column,
    distinct,
    known,
    middle,
    rate,
    right,
    where,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of

PEER = "kiss"
NINETY_NINE = 99.0  # percentile


def speed_section(rows: Sequence[Row], seconds: Sequence[Row], settings: PairSetSettings) -> Section:
    """All tables are times, which may differ between runs."""
    methods = settings.compared.methods
    right_and_accepted = {
        "right": lambda some: rate(right(some), some),
        "accepted": lambda some: rate(accepted(some), some),
    }
    success = table_of("Success on the timed pairs", ("method",), by_method(rows, methods), right_and_accepted)
    return Section(
        title="Time to register a pair",
        introduction=(
            f"{len(distinct(rows, 'number'))} pairs of the set {settings.seed} that share more than 20 % of their "
            f"points, any yaw, tilt up to 35 degrees, on grids of {settings.edge} voxels along each edge. Both scans "
            "are prepared first, and the pair is registered once without being timed. Then the methods take turns to "
            "register it, three times each; the fastest of the three counts. One process registers one pair at a time. "
            f"{settings.compared.words}"
        ),
        tables=(),
        times=(time_table(seconds, methods), spread_table(seconds), success),
    )


def time_table(seconds: Sequence[Row], methods: Sequence[str]) -> Table:
    """The times of each method, and the ratio of ours to them, pair by pair."""
    ours, timed = _times(seconds, OURS), known(seconds, "register_s")

    def ratio(some: Sequence[Row]) -> str:
        ratios = [ours[row["number"]] / float(row["register_s"]) for row in some if row["number"] in ours]
        return f"{median(ratios):.2f}" if ratios else DASH

    return table_of(
        "Registering a pair",
        ("method",),
        [group for group in by_method(timed, methods) if group[1]],
        {
            "pairs": lambda some: str(len(some)),
            "min [s]": lambda some: f"{min(column(some, 'register_s')):.3f}",
            "median [s]": lambda some: f"{middle(some, 'register_s'):.3f}",
            "99th percentile [s]": lambda some: f"{_last(column(some, 'register_s')):.3f}",
            "max [s]": lambda some: f"{max(column(some, 'register_s')):.3f}",
            f"time of {OURS} / time of the method, median over the pairs": ratio,
            "preparing a scan, median [s]": lambda some: f"{middle(known(some, 'prepare_s'), 'prepare_s'):.3f}",
        },
    )


def spread_table(seconds: Sequence[Row]) -> Table:
    """How much the times of ours vary, and how they compare with the peer's."""
    ours, peer = _times(seconds, OURS), _times(seconds, PEER)
    lines = []
    if ours:
        lines.append((f"{OURS}: 99th percentile / median", f"{_last(ours.values()) / median(ours.values()):.2f}"))
    if both := [ours[number] / peer[number] for number in ours if number in peer]:
        lines.append((f"{OURS} / {PEER}, pair by pair, median", f"{median(both):.2f}"))
    return Table(f"Ratios of the times of `{OURS}`", ("ratio of", "value"), tuple(lines))


def _times(seconds: Sequence[Row], method: str) -> dict[object, float]:
    """Of a pair [s], by the pair's number."""
    some = known(where(seconds, method=method), "register_s")
    return {row["number"]: float(row["register_s"]) for row in some}


def _last(times: Iterable[float]) -> float:
    return float(np.percentile(list(times), NINETY_NINE))
