"""Writes the files of an experiment: rows, a page with tables, run times, and a record."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.files.writers.tables import to_json, write_json, write_table
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Experiment, Row
from sonarmap.tools.lab.reproduce.render import Rendered, frame_of, render
from sonarmap.tools.lab.reproduce.run import Provenance, Result
from sonarmap.tools.lab.reproduce.tables import SHOWN


@dataclass(frozen=True, slots=True)
class Record:
    """The content of NAME.json."""

    name: str  # of the experiment
    command: str  # command line that produces the same rows
    title: str
    tables: tuple[Rendered, ...]  # the settings, then the results
    times: tuple[Rendered, ...]  # tables of run times
    seconds: float  # total time of all jobs [s]
    jobs: int  # number of jobs
    provenance: Provenance  # of the rows
    files: tuple[str, ...]  # names of all written files, including NAME.json


def write_experiment(
    folder: Path, experiment: Experiment, result: Result, shown: Sequence[Row], provenance: Provenance, command: str
) -> Record:
    """Write NAME.csv and NAME.md, the same on every run, and NAME-seconds.csv, NAME-times.md and NAME.json.

    `shown` are the rows of the tables. Raises InputError: a file cannot be written; then no file is written.
    """
    name, rows, seconds = experiment.name, result.rows, result.times
    timed = [f"{name}-seconds.csv"] if seconds else []
    settings = tuple((setting, json.dumps(value)) for setting, value in provenance.settings.items())
    record = Record(
        name=name,
        command=command,
        title=f"{name}: {EXPERIMENTS[name].shows}",
        tables=(Rendered("Settings", ("setting", "value"), settings), *_rendered(name, shown, times=False)),
        times=_rendered(name, seconds, times=True),
        seconds=sum(result.job_seconds.values()),
        jobs=len(result.outcomes),
        provenance=provenance,
        files=(f"{name}.csv", f"{name}.md", *timed, f"{name}-times.md", f"{name}.json"),
    )
    with all_or_none():
        write_rows(folder / f"{name}.csv", rows)
        if seconds:
            write_rows(folder / f"{name}-seconds.csv", seconds)
        _write(folder / f"{name}.md", _page(record))
        _write(folder / f"{name}-times.md", f"# {record.title}: times\n\n{_times(record)}")
        write_json(folder / f"{name}.json", to_json(record) | {"job_seconds": result.job_seconds})
    return record


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as CSV, with a column for every key in order of first appearance, floats with four decimals, Booleans
    as 1 and 0, and empty cells for NaN."""
    rows = list(rows)
    headings = list(dict.fromkeys(key for row in rows for key in row))
    write_table(path, headings, ([_cell(row.get(key, "")) for key in headings] for row in rows))


def duration(seconds: float) -> str:
    """A duration as text, such as "41 s", "12 min" or "3 h 05 min"."""
    minutes = round(seconds / 60)
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def _rendered(name: str, rows: Sequence[Row], *, times: bool) -> tuple[Rendered, ...]:
    frame = frame_of(rows)
    tables = [render(table, frame) for table in SHOWN[name] if table.times == times]
    return tuple(table for table in tables if table is not None)


def _page(record: Record) -> str:
    tables = "\n".join(table.markdown() for table in record.tables)
    rows = f"[{record.name}.csv]({record.name}.csv)"
    times = f"[{record.name}-times.md]({record.name}-times.md)"
    made = f"Every row: {rows}. Times: {times}. Made by\n\n```sh\n{record.command}\n```\n"
    return f"# {record.title}\n\n{tables}\n{made}"


def _times(record: Record) -> str:
    """Markdown of the run times and the machine."""
    tables = "".join(f"{table.markdown()}\n" for table in record.times)
    versions = record.provenance.versions.items()
    installed = ", ".join(f"{name} {version}" for name, version in versions if version and name != "system")
    return f"{tables}{record.jobs} jobs in {duration(record.seconds)} on {record.provenance.place}, with {installed}.\n"


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:z.4f}"
    return str(value)


def _write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_bytes(text.encode())
