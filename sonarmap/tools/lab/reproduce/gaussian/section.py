"""Table 1 in words and tables."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from statistics import median, median_low
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.answer import less_turns
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.gaussian.series import RANKED, VARIANTS
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
from sonarmap.tools.lab.reproduce.settings import EXTENT
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
        introduction=_introduction(settings.scene, rows),
        tables=(verdict_table(rows), detail_table(rows), *_scan_tables(rows)),
        times=(_time_table(seconds),),
        pictures=captions | {RATES: "The share of seeds that are right at each scan, with 95 % intervals."},
        remarks=remarks(rows),
    )


def parameters_picture(edge: int) -> str:
    """File name of the picture after Figs. 20 and 21 on a grid."""
    return f"gaussian-{edge}.png"


def _introduction(scene: str, rows: Sequence[Row]) -> str:
    voxels = {int(row["grid"]): float(row["voxel_m"]) for row in rows}
    grids = " and ".join(f"{grid}³ voxels of {voxel:g} m" for grid, voxel in voxels.items())
    meters = ", ".join(f"{RIGHT_VOXELS * voxel:g} m at {grid}³" for grid, voxel in voxels.items())
    methods = "\n".join(f"- **{name}**: {method.title}" for name, method in VARIANTS.items())
    first, last = min(column(rows, "seed")), max(column(rows, "seed"))
    seeds = f"{first:.0f}" if first == last else f"{first:.0f} to {last:.0f}"
    return f"""Scans S0 to S9 of the scene `{scene}` are registered to a reference scan. Each is farther from it than
the one before, by (4, 8, 12) m and by 6, 2 and 1 degrees of yaw, roll and pitch. The variance of the noise grows along
the beam, to σ² at the largest range. Grids: {grids}, {EXTENT:g} m along each edge, as the paper's 256 voxels. Seeds:
{seeds}; each has a scene and noise of its own. Rates have Wilson's 95 % intervals.

A registration is right if T_target_source, between the sensor frames, is within {RIGHT_DEG:g} degrees and \
{RIGHT_VOXELS:g} voxels of the truth ({meters}). The paper shows curves and says up to which scan its registrations \
succeed, but gives no error bound.

{methods}"""


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


# Structure fixed to the sensor or to the grid has its false yaw peaks at multiples of a quarter turn.
_NEAR_DEG = 15.0
_BY_CHANCE = 4 * 2 * RIGHT_DEG / 360


def remarks(rows: Sequence[Row]) -> str:
    """One paragraph for each grid and method."""
    groups = grouped(rows, "grid", "method").items()
    return "\n".join(f"- **{grid}³, {method}**: {_paragraph(some, rows)}" for (grid, method), some in groups)


def _paragraph(mine: Sequence[Row], rows: Sequence[Row]) -> str:
    steps = {step: some for step in STEPS if (some := where(mine, wrong_step=step))}
    if not steps:
        return f"all {len(mine)} registrations are right."
    counts = ", ".join(f"{step} in {len(some)}" for step, some in steps.items())
    failed = sum(map(len, steps.values()))
    sentences = [f"{failed} of {len(mine)} registrations are wrong. The first wrong step is {counts}."]
    if yaw := steps.get("yaw"):
        sentences += [_on_yaw(yaw), *_on_near(yaw), *_on_others(yaw, rows)]
    if tilt := steps.get("tilt"):
        off = median(map(tilt_error, tilt))
        sentences.append(f"Where roll and pitch are wrong first, the vertical is off by a median of {off:.0f} degrees.")
    if translation := steps.get("translation"):
        sentences.append(
            f"Where only the translation is wrong, the median errors are {middle(translation, 'rotation_deg'):.1f} "
            f"degrees and {middle(translation, 'translation_m'):.1f} m. Measured at the scan's center, "
            f"{len(where(translation, right_at_center=True))} of {len(translation)} would be right; in these, the "
            "translation at the sensor is wrong because the sensor is far from the scan's center and the rotation is "
            "slightly off."
        )
    return " ".join(sentences)


def _on_yaw(failed: Sequence[Row]) -> str:
    """How the yaw is wrong, whether roll and pitch are right, and whether the false peak is fixed to the sensor."""
    errors = [abs(yaw_error(row)) for row in failed]
    near, about = sum(error <= _NEAR_DEG for error in errors), sum(error >= 180 - _NEAR_DEG for error in errors)
    upright = sum(tilt_error(row) <= RIGHT_DEG for row in failed)
    quarters = sum(abs((float(row["found_yaw_deg"]) + 45) % 90 - 45) <= RIGHT_DEG for row in failed)
    return (
        f"Of these {len(failed)} yaws, {near} are off by at most {_NEAR_DEG:g} degrees, {about} by 180 degrees (to "
        f"within {_NEAR_DEG:g}) and {len(failed) - near - about} by another angle; roll and pitch are right in "
        f"{upright} of them. The number within {RIGHT_DEG:g} degrees of 0, 90, 180 or 270, where structure fixed to "
        f"the sensor or to the grid has its peaks, is {quarters} (by chance: {_BY_CHANCE:.0%}). The right yaw is the "
        f"highest peak of the first step in {among(failed, 1)}, among its {FEW} highest in {among(failed, FEW)} and "
        f"among its {RANKED} highest in {among(failed, RANKED)}."
    )


def _on_near(failed: Sequence[Row]) -> list[str]:
    """Whether yaws that are nearly right err to one side, and by how much these scans are tilted."""
    near = [row for row in failed if abs(yaw_error(row)) <= _NEAR_DEG]
    if not near:
        return []
    small = sum(yaw_error(row) < 0 for row in near)
    rolls = abs(column(near, "true_roll_deg"))
    return [
        f"Yaws off by at most {_NEAR_DEG:g} degrees are too small in {small} of {len(near)} cases; their median error "
        f"is {median(abs(yaw_error(row)) for row in near):.0f} degrees, under true rolls of {min(rolls):.0f} to "
        f"{max(rolls):.0f} degrees."
    ]


def _on_others(failed: Sequence[Row], rows: Sequence[Row]) -> list[str]:
    """How often each other method has the right yaw where this one has not."""
    names = ("grid", "sigma2", "seed", "scan")
    pairs, others = grouped(failed, *names), [row for row in rows if row["method"] != failed[0]["method"]]
    sentences = []
    for (method,), some in grouped(others, "method").items():
        both = [row for key, trials in grouped(some, *names).items() if key in pairs for row in trials]
        count = sum(abs(yaw_error(row)) <= RIGHT_DEG for row in both)
        sentences.append(f"*{method}* has the right yaw in {count} of these {len(pairs)}.")
    return sentences


def yaw_error(row: Row) -> float:
    """Of the yaw alone [degrees], -180..180."""
    return less_turns(float(row["found_yaw_deg"]) - float(row["true_yaw_deg"]))


def tilt_error(row: Row) -> float:
    """The angle between the verticals, which roll and pitch alone decide [degrees]."""
    angles = [[float(row[f"{which}_{name}_deg"]) for name in ("pitch", "roll")] for which in ("found", "true")]
    up = Rotation.from_euler("YX", angles, degrees=True).inv().apply([0.0, 0.0, 1.0])
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(up[0], up[1])), up[0] @ up[1])))
