"""The time to register a pair, in words and tables."""

import math
from collections.abc import Iterable, Sequence
from statistics import median

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import DASH, accepted, rate, right, where
from sonarmap.tools.lab.reproduce.table import Table

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
    lines = []
    for method in methods:
        times = _times(seconds, method)
        if not times:
            continue
        ratios = [ours[number] / time for number, time in times.items() if number in ours]
        prepare = [float(row["prepare_s"]) for row in where(seconds, method=method)]
        lines.append(
            (
                method,
                str(len(times)),
                *(f"{value:.3f}" for value in (min(times.values()), median(times.values()), _last(times.values()))),
                f"{max(times.values()):.3f}",
                f"{median(ratios):.2f}" if ratios else DASH,
                f"{median(value for value in prepare if not math.isnan(value)):.3f}",
            )
        )
    headings = ("method", "pairs", "min [s]", "median [s]", "99th percentile [s]", "max [s]")
    ratio = f"time of {OURS} / time of the method, median over the pairs"
    return Table("Registering a pair", (*headings, ratio, "preparing a scan, median [s]"), tuple(lines))


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
    lines = []
    for method in methods:
        some = where(rows, method=method)
        lines.append((method, rate(right(some), some), rate(accepted(some), some)))
    return Table("Success on the timed pairs", ("method", "right", "accepted"), tuple(lines))


def _times(seconds: Sequence[Row], method: str) -> dict[object, float]:
    """Of a pair [s], by the pair's number."""
    some = where(seconds, method=method)
    return {row["number"]: float(row["register_s"]) for row in some if not math.isnan(float(row["register_s"]))}


def _last(times: Iterable[float]) -> float:
    return float(np.percentile(list(times), NINETY_NINE))
