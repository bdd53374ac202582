"""Growth with the number of scans, in words and tables."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.beside import HEADINGS
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import DASH, column, for_each, grouped, where
from sonarmap.tools.lab.reproduce.table import Table, table_of

WHOLE = "all"  # the stages


def scale_section(rows: Sequence[Row], seconds: Sequence[Row], settings: Any) -> Section:
    """Poses and pairs; and apart times and memory by stage, which differ between runs; `settings`: ScaleSettings."""
    loops = {
        "loops kept / tried": lambda row: f"{row['kept_loops']:,} / {row['tried_loops']:,}",
        "wrong pairs kept": lambda row: f"{row['wrong_kept']}",
        "points of the map": lambda row: f"{row['map_points']:,}",
    }
    surveys = [((f"{row['scans']:,}", f"{row['seed']}"), row) for row in rows]
    title = f"Processor time and most memory by stage, seed {settings.first_seed}"
    first = where(seconds, seed=settings.first_seed)
    stages = [((str(stage),), some) for (stage,), some in grouped(first, "stage").items()]
    counts = for_each("scans", settings.counts, _time_and_memory)
    by_stage = {f"{int(count):,} scans": cell for count, cell in counts.items()}
    return Section(
        title="Thousands of scans",
        tables=(
            _measured(rows, settings.voxel),
            table_of("What became of the loops", ("scans", "seed"), surveys, loops),
        ),
        times=(_growth(where(seconds, stage=WHOLE)), table_of(title, ("stage",), stages, by_stage)),
    )


def _time_and_memory(rows: Sequence[Row]) -> str:
    return f"{float(rows[0]['processor_s']):.1f} s, {float(rows[0]['memory_mib']):.0f} MiB" if rows else ""


def _measured(rows: Sequence[Row], voxel: float) -> Table:
    lines: list[tuple[str, ...]] = []
    for row in rows:
        survey, placed, ate = f"{row['scans']:,} scans, seed {row['seed']}", int(row["placed"]), float(row["ate_m"])
        missing = int(row["scans"]) - placed
        lines.append((survey, "scans in one map", f"{placed:,}", DASH, f"{missing:,} scans are missing in it"))
        follows = f"poses are {ate / voxel:.2f} voxels off"
        lines.append((survey, "error of the poses (ATE) [m]", f"{ate:.3f}", DASH, follows))
    return Table("Poses", ("survey", *HEADINGS), tuple(lines))


def _growth(whole: Sequence[Row]) -> Table:
    """Of each number of scans against the one before."""
    by_count = {int(count): some for (count,), some in sorted(grouped(whole, "scans").items())}
    means = {count: float(column(some, "processor_s").mean()) for count, some in by_count.items()}
    exponents = {b: np.log(means[b] / means[a]) / np.log(b / a) for a, b in pairwise(means)}
    columns = {
        "processor time [s]": lambda count: f"{means[count]:.0f}",
        "a scan [ms]": lambda count: f"{1000 * means[count] / count:.0f}",
        "grows with the power": lambda count: f"{exponents[count]:.2f}" if count in exponents else "",
        "most memory [MiB]": lambda count: f"{max(column(by_count[count], 'memory_mib')):.0f}",
    }
    return table_of("Growth", ("scans",), [((f"{count:,}",), count) for count in means], columns)
