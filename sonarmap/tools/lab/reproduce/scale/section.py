"""Growth with the number of scans, in words and tables."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sonarmap.tools.lab.reproduce.beside import HEADINGS
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import DASH, where
from sonarmap.tools.lab.reproduce.scale.measured import WHOLE, ScaleSettings
from sonarmap.tools.lab.reproduce.table import Table, table_of


def scale_section(rows: Sequence[Row], seconds: Sequence[Row], settings: ScaleSettings) -> Section:
    """Poses and pairs; and apart, as they differ between runs, times and memory by stage."""
    return Section(
        title="Thousands of scans",
        introduction=_introduction(settings),
        tables=(_measured(rows, settings.voxel), _outcomes(rows)),
        times=(_growth(where(seconds, stage=WHOLE)), _stages(seconds, settings)),
    )


def _introduction(settings: ScaleSettings) -> str:
    return (
        f"Surveys in lanes over a rough bed, of {', '.join(f'{count:,}' for count in settings.counts)} scans of "
        f"{settings.points:,} points, which lie on disk. Registrations are made up from the truth, with errors of the "
        "size that they tell; 2 % of them are refused, and of 1,000 loops 2 are wrong. So what is measured is the "
        "mapper's own work: which pairs are tried, which are believed, where the poses are, and the fused map. "
        f"The survey's voxels are of {settings.voxel:g} m. Memory is what the process holds beside files."
    )


def _measured(rows: Sequence[Row], voxel: float) -> Table:
    lines: list[tuple[str, ...]] = []
    for row in rows:
        survey, placed, ate = f"{row['scans']:,} scans, seed {row['seed']}", int(row["placed"]), float(row["ate_m"])
        missing = int(row["scans"]) - placed
        lines.append((survey, "scans in one map", f"{placed:,}", DASH, f"{missing:,} scans are missing in it"))
        follows = f"poses are {ate / voxel:.2f} voxels off"
        lines.append((survey, "error of the poses (ATE) [m]", f"{ate:.3f}", DASH, follows))
    return Table("Poses", ("survey", *HEADINGS), tuple(lines))


def _outcomes(rows: Sequence[Row]) -> Table:
    return table_of(
        "What became of the loops",
        ("scans", "seed"),
        [((f"{row['scans']:,}", f"{row['seed']}"), row) for row in rows],
        {
            "loops kept / tried": lambda row: f"{row['kept_loops']:,} / {row['tried_loops']:,}",
            "wrong pairs kept": lambda row: f"{row['wrong_kept']}",
            "points of the map": lambda row: f"{row['map_points']:,}",
        },
    )


def _growth(whole: Sequence[Row]) -> Table:
    """Of each number of scans against the one before."""
    by_count: dict[int, list[Row]] = {}
    for row in whole:
        by_count.setdefault(int(row["scans"]), []).append(row)
    means = {n: float(np.mean([float(row["processor_s"]) for row in rows])) for n, rows in sorted(by_count.items())}
    exponents = {b: np.log(means[b] / means[a]) / np.log(b / a) for a, b in pairwise(means)}
    lines: list[tuple[str, ...]] = []
    for count, seconds in means.items():
        memory = max(float(row["memory_mib"]) for row in by_count[count])
        exponent = f"{exponents[count]:.2f}" if count in exponents else ""
        lines.append((f"{count:,}", f"{seconds:.0f}", f"{1000 * seconds / count:.0f}", exponent, f"{memory:.0f}"))
    headings = ("scans", "processor time [s]", "a scan [ms]", "grows with the power", "most memory [MiB]")
    return Table("Growth", headings, tuple(lines))


def _stages(seconds: Sequence[Row], settings: ScaleSettings) -> Table:
    stages = list(dict.fromkeys(str(row["stage"]) for row in seconds))
    first = where(seconds, seed=settings.first_seed)
    lines = []
    for stage in stages:
        of_stage = {int(row["scans"]): row for row in where(first, stage=stage)}
        cells = [
            f"{float(row['processor_s']):.1f} s, {float(row['memory_mib']):.0f} MiB" if row else ""
            for row in (of_stage.get(count) for count in settings.counts)
        ]
        lines.append((stage, *cells))
    headings = ("stage", *(f"{count:,} scans" for count in settings.counts))
    return Table(f"Processor time and most memory by stage, seed {settings.first_seed}", headings, tuple(lines))
