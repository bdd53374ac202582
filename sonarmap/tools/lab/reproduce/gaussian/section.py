"""Table 1 in words and tables."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from statistics import median_low
from types import MappingProxyType
from typing import Any

from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.gaussian.series import RANKED
from sonarmap.tools.lab.reproduce.rows import (
    accepted,
    column,
    distinct,
    grouped,
    last_right,
    middle,
    rate,
    refused,
    right,
    step_name,
    where,
    wrong,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of

# sigma^2 [m^2] -> the last scan up to which the paper's registrations succeed (Figs. 20, 21)
PAPER_LAST: Mapping[float, int] = MappingProxyType({1.0: 8, 2.0: 6})
# Voxels per edge -> time of a registration from the raw scans (Sect. 4.4; MATLAB, 2010)
_PAPER_SECONDS = {128: "10.5 s", 256: "60.6 s"}
STEPS = ("yaw", "tilt", "translation")
FEW = HemisphereConfig().yaw_peaks  # as many yaw peaks as "six peaks" follows
RATES = "gaussian-rates.png"
_CLOSE_M = 3.0  # three of the paper's voxels


def gaussian_section(rows: Sequence[Row], seconds: Sequence[Row], settings: Any) -> Section:
    """Our results next to the paper's, and which step fails first; `settings` are GaussianSettings."""
    captions = {
        parameters_picture(int(grid)): f"As Figs. 20 and 21, {grid}³ voxels, seed {min(column(rows, 'seed')):.0f}. "
        "Lines are true values, crosses are estimates; gray marks wrong registrations."
        for grid in distinct(rows, "grid")
    }
    return Section(
        title="Gaussian noise along the beams: Table 1, Figs. 20 and 21",
        tables=(verdict_table(rows), detail_table(rows), *_scan_tables(rows)),
        times=(_time_table(seconds),),
        pictures=captions | {RATES: "The share of seeds that are right at each scan, with 95 % intervals."},
    )


def parameters_picture(edge: int) -> str:
    """File name of the picture after Figs. 20 and 21 on a grid."""
    return f"gaussian-{edge}.png"


def verdict_table(rows: Sequence[Row]) -> Table:
    """How far every seed gets, next to the paper, and what is believed; a line for each grid, noise and method."""

    def paper(some: Sequence[Row]) -> int | None:
        return PAPER_LAST.get(float(some[0]["sigma2"]))

    def ours(some: Sequence[Row]) -> str:
        last = last_right(some, "scan", "seed")
        return f"{step_name(median_low(last))} ({' '.join(map(step_name, last))})"

    def verdict(some: Sequence[Row]) -> str:
        wanted, last = paper(some), last_right(some, "scan", "seed")
        if wanted is None:
            return ""
        reached = sum(end >= wanted for end in last)
        some_seeds = f"reached by {reached} of {len(last)} seeds" if reached else "not reached"
        return "reached" if reached == len(last) else some_seeds

    columns = {
        "paper": lambda some: "" if (last := paper(some)) is None else f"S{last}",
        "ours, median (each seed)": ours,
        "verdict": verdict,
        "right": lambda some: rate(right(some), some),
        "accepted though wrong": lambda some: str(len(accepted(wrong(some)))),
        "refused though right": lambda some: str(len(refused(right(some)))),
    }
    return table_of("The last scan before the first failure", ("grid", "σ²", "method"), _cases(rows), columns)


def detail_table(rows: Sequence[Row]) -> Table:
    """The first wrong step of every failure, and of the one that ends a seed; and how accurate is what is right."""

    def counts(numbers: Iterable[int]) -> str:
        return " / ".join(map(str, numbers))

    def steps(some: Iterable[Row]) -> str:
        of_step = Counter(row["wrong_step"] for row in some)
        return counts(of_step[step] for step in STEPS)

    def ending(some: Sequence[Row]) -> str:
        series = (sorted(wrong(mine), key=lambda row: row["scan"])[:1] for mine in grouped(some, "seed").values())
        return steps(row for first in series for row in first)

    def errors(some: Sequence[Row]) -> str:
        good = right(some)
        return f"{middle(good, 'rotation_deg'):.2f}°, {middle(good, 'translation_m'):.2f} m" if good else ""

    columns = {
        "first wrong: yaw / tilt / translation": lambda some: steps(wrong(some)),
        "series ended by each of these": ending,
        f"right yaw is the highest peak / among the {FEW} highest / among the {RANKED} highest": lambda some: counts(
            among(some, count) for count in (1, FEW, RANKED)
        ),
        "right": lambda some: str(len(right(some))),
        "right with the translation at the scan's center": lambda some: str(len(where(some, right_at_center=True))),
        "right and within 3 m": lambda some: str(sum(column(right(some), "translation_m") <= _CLOSE_M)),
        "median error where right": errors,
    }
    title = "Which step fails first, and how accurate the right registrations are"
    return table_of(title, ("grid", "σ²", "method"), _cases(rows), columns)


def _cases(rows: Sequence[Row]) -> list[tuple[tuple[str, ...], list[Row]]]:
    groups = grouped(rows, "grid", "sigma2", "method").items()
    return [((f"{grid}³", f"σ² = {sigma2:g} m²", method), some) for (grid, sigma2, method), some in groups]


def among(rows: Iterable[Row], count: int) -> int:
    """In how many rows the right yaw is among so many highest peaks."""
    return sum(0 < int(row["yaw_rank"]) <= count for row in rows)


def _scan_tables(rows: Sequence[Row]) -> list[Table]:
    """Every scan on one grid under one noise: rates, and the median error of all seeds, right or wrong."""
    tables = []
    for (grid, sigma2), some in grouped(rows, "grid", "sigma2").items():
        headings, lines = ["scan"], {scan: [step_name(scan)] for scan in sorted({int(row["scan"]) for row in some})}
        for (method,), mine in grouped(some, "method").items():
            headings += [f"{method}: right", "median error"]
            for scan, line in lines.items():
                trials = where(mine, scan=scan)
                error = f"{middle(trials, 'rotation_deg'):.1f}°, {middle(trials, 'translation_m'):.1f} m"
                line += [rate(right(trials), trials), error]
        title = f"Every scan at {grid}³, σ² = {sigma2:g} m²"
        tables.append(Table(title, tuple(headings), tuple(map(tuple, lines.values()))))
    return tables


def _time_table(times: Sequence[Row]) -> Table:
    columns = {
        "paper, from raw scans": lambda some: _PAPER_SECONDS.get(int(some[0]["grid"]), ""),
        "two preparations and one registration": lambda some: (
            f"{2 * middle(some, 'prepare_s') + middle(some, 'register_s'):.2f} s"
        ),
        "one preparation": lambda some: f"{middle(some, 'prepare_s'):.2f} s",
        "one registration": lambda some: f"{middle(some, 'register_s'):.2f} s",
    }
    groups = [((f"{grid}³", method), some) for (grid, method), some in grouped(times, "grid", "method").items()]
    return table_of("Median run times", ("grid", "method"), groups, columns)
