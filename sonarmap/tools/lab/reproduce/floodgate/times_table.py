"""Table 2 of the paper: seconds of every registration, next to ours."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import mean, median

from sonarmap.tools.lab.reproduce.experiment import Outcome, Row
from sonarmap.tools.lab.reproduce.floodgate.methods import label
from sonarmap.tools.lab.reproduce.floodgate.tables import Run
from sonarmap.tools.lab.reproduce.rows import all_seconds
from sonarmap.tools.lab.reproduce.table import Table

# The pairs 0 -> 1 to 16 -> 17 by ICP (Table 2) [s], a Core 2 Duo of 1.8 GHz, C++. Their mean is 21.346; printed is
# 21.403.
PAPER_ICP = (
    *(47.36, 43.44, 28.17, 1.95, 37.89, 12.00, 26.27, 2.21, 15.34),
    *(17.75, 16.99, 15.70, 1.27, 26.22, 2.56, 41.31, 26.45),
)
PAPER_ICP_MEAN = 21.403


@dataclass(frozen=True, slots=True)
class PaperTime:
    """What Sects. 4.2 to 4.4 say of a method's times [s]; None where nothing is said."""

    prepare: str
    least: float | None
    mean: float
    most: float | None


_PAPER: Mapping[Run, PaperTime] = {
    ("icp", 0): PaperTime("", min(PAPER_ICP), PAPER_ICP_MEAN, max(PAPER_ICP)),
    ("planes", 0): PaperTime("0.9..1.4", 8.0, 31.0, 56.0),
    ("hemisphere", 128): PaperTime("included", 10.5, 10.5, 10.5),
    ("hemisphere", 256): PaperTime("included", 60.6, 60.6, 60.6),
}


def times_tables(outcomes: Mapping[str, Outcome]) -> tuple[Table, ...]:
    """Times by method, then by pair; of all surveys."""
    rows = all_seconds(outcomes)
    if not rows:
        return ()
    runs = {run: [row for row in rows if _run(row) == run] for run in dict.fromkeys(_run(row) for row in rows)}
    return (_summary(runs), _pairs(runs))


def _summary(runs: Mapping[Run, list[Row]]) -> Table:
    lines = []
    for run, rows in runs.items():
        seconds = [float(row["register_s"]) for row in rows]
        spread = max(seconds) / median(seconds)
        ours = (mean(float(row["prepare_s"]) for row in rows), min(seconds), mean(seconds), median(seconds))
        lines.append((label(*run), *_paper(run), *(f"{value:.2f}" for value in (*ours, max(seconds), spread))))
    return Table(
        "Seconds per registration, without preparing the scans; the paper: fixed for spectral, varying for the others",
        (
            "method",
            *("paper: preparing", "paper: min", "paper: mean", "paper: max"),
            *("ours: preparing, mean", "ours: min", "ours: mean", "ours: median", "ours: max", "ours: max / median"),
        ),
        tuple(lines),
    )


def _paper(run: Run) -> tuple[str, ...]:
    said = _PAPER.get(run)
    if said is None:
        return ("", "", "", "")
    return (said.prepare, *("" if value is None else f"{value:g}" for value in (said.least, said.mean, said.most)))


def _pairs(runs: Mapping[Run, list[Row]]) -> Table:
    """Table 2 as printed, and our medians over the surveys next to it."""
    sources = sorted({int(row["scan"]) for rows in runs.values() for row in rows})
    lines = [
        (
            f"{source - 1} → {source}",
            f"{PAPER_ICP[source - 1]:.2f}",
            *(_median(row for row in rows if row["scan"] == source) for rows in runs.values()),
        )
        for source in sources
    ]
    average = ("average", f"{PAPER_ICP_MEAN:.3f}", *(_mean(rows) for rows in runs.values()))
    return Table(
        "Table 2: seconds of every registration",
        ("pair", "paper: ICP", *(f"ours: {label(*run)}" for run in runs)),
        (*lines, average),
    )


def _run(row: Row) -> Run:
    return str(row["method"]), int(row["grid"])


def _median(rows: Iterable[Row]) -> str:
    seconds = [float(row["register_s"]) for row in rows]
    return f"{median(seconds):.2f}" if seconds else ""


def _mean(rows: list[Row]) -> str:
    return f"{mean(float(row['register_s']) for row in rows):.3f}"
