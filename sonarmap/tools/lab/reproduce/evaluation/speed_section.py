"""The time to register a pair, in words and tables."""

from collections.abc import Iterable, Mapping, Sequence
from statistics import median

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import DASH, accepted, known, middle, rate, right, where
from sonarmap.tools.lab.reproduce.table import Table, table_of

PEER = "kiss"
NINETY_NINE = 99.0  # percentile


def speed_section(rows: Sequence[Row], seconds: Sequence[Row], settings: PairSetSettings) -> Section:
    """All tables are times, which may differ between runs."""
    methods = settings.compared.methods
    count = len({row["number"] for row in rows})
    return Section(
        title="Time to register a pair",
        introduction=(
            f"{count} pairs of the set {settings.seed} that share more than 20 % of their points, any yaw, tilt up to "
            f"35 degrees, on grids of {settings.edge} voxels along each edge. Both scans are prepared first, and the "
            "pair is registered once without being timed. Then the methods take turns to register it, three times "
            "each; the fastest of the three counts. One process registers one pair at a time. "
            f"{settings.compared.words}"
        ),
        tables=(),
        times=(time_table(seconds, methods), spread_table(seconds), _right_table(rows, methods)),
    )


def time_table(seconds: Sequence[Row], methods: Sequence[str]) -> Table:
    """The times of each method, and the ratio of ours to them, pair by pair."""
    ours = _times(seconds, OURS)

    def ratio(times: Mapping[object, float]) -> str:
        ratios = [ours[pair] / time for pair, time in times.items() if pair in ours]
        return f"{median(ratios):.2f}" if ratios else DASH

    def prepare(method: str) -> str:
        return f"{middle(known(where(seconds, method=method), 'prepare_s'), 'prepare_s'):.3f}"

    timed = {method: times for method in methods if (times := _times(seconds, method))}
    return table_of(
        "Registering a pair",
        ("method",),
        [((method,), method) for method in timed],
        {
            "pairs": lambda method: str(len(timed[method])),
            "min [s]": lambda method: f"{min(timed[method].values()):.3f}",
            "median [s]": lambda method: f"{median(timed[method].values()):.3f}",
            "99th percentile [s]": lambda method: f"{_last(timed[method].values()):.3f}",
            "max [s]": lambda method: f"{max(timed[method].values()):.3f}",
            f"time of {OURS} / time of the method, median over the pairs": lambda method: ratio(timed[method]),
            "preparing a scan, median [s]": prepare,
        },
    )


def spread_table(seconds: Sequence[Row]) -> Table:
    """How much the times of ours vary, and how they compare with the peer's."""
    ours, peer = _times(seconds, OURS), _times(seconds, PEER)
    lines = []
    if ours:
        lines.append((f"{OURS}: 99th percentile / median", f"{_last(ours.values()) / median(ours.values()):.2f}"))
    both = [ours[number] / peer[number] for number in ours if number in peer]
    if both:
        lines.append((f"{OURS} / {PEER}, pair by pair, median", f"{median(both):.2f}"))
    return Table(f"Ratios of the times of `{OURS}`", ("ratio of", "value"), tuple(lines))


def _right_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    return table_of(
        "Success on the timed pairs",
        ("method",),
        [((method,), where(rows, method=method)) for method in methods],
        {
            "right": lambda some: rate(right(some), some),
            "accepted": lambda some: rate(accepted(some), some),
        },
    )


def _times(seconds: Sequence[Row], method: str) -> dict[object, float]:
    """Of a pair [s], by the pair's number."""
    some = known(where(seconds, method=method), "register_s")
    return {row["number"]: float(row["register_s"]) for row in some}


def _last(times: Iterable[float]) -> float:
    return float(np.percentile(list(times), NINETY_NINE))
