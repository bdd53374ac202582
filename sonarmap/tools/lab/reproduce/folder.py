"""The files that an experiment leaves: its rows, its pictures, its page, its times, and a record of it all."""

import json
import re
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from sonarmap.tools.files.readers.json_file import read_json
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path, discard
from sonarmap.tools.files.writers.json_text import to_json, write_json
from sonarmap.tools.lab.reproduce.experiment import Experiment, Row, Section
from sonarmap.tools.lab.reproduce.provenance import Provenance
from sonarmap.tools.lab.reproduce.run import Result
from sonarmap.tools.lab.reproduce.table import Table, write_csv


@dataclass(frozen=True, slots=True)
class Record:
    """What NAME.json holds."""

    name: str  # the experiment's
    command: str  # the command line that makes the same rows again
    section: Section  # its words and tables
    seconds: float  # of all jobs together [s]
    jobs: int  # how many
    provenance: Provenance  # where the rows come from
    files: tuple[str, ...]  # all that were written, NAME.json among them


def write_experiment(
    folder: Path, experiment: Experiment, result: Result, provenance: Provenance, command: str
) -> Record:
    """Write NAME.csv, NAME*.png, NAME.md, which two runs make alike byte by byte; and, as they may differ,
    NAME-seconds.csv, NAME-times.md and NAME.json. All of them or, where one cannot be written, none.

    Raises:
        InputError: a file cannot be written.
        ValueError: the experiment's section or pictures are not what they should be.
    """
    rows = [row for outcome in result.outcomes.values() for row in outcome.rows]
    seconds = [row for outcome in result.outcomes.values() for row in outcome.seconds]
    name, section = experiment.name, experiment.section(rows, seconds)
    verdicts(section)
    words = [f"{name}.csv", f"{name}.md", *([f"{name}-seconds.csv"] if seconds else []), f"{name}-times.md"]
    files = (*words, *section.pictures, f"{name}.json")
    record = Record(name, command, section, result.seconds, len(result.outcomes), provenance, files)
    former = read_record(folder, name)
    with tempfile.TemporaryDirectory() as drawn:
        experiment.draw(Path(drawn), rows)
        with all_or_none():
            _copy_pictures(Path(drawn), folder, name, section)
            write_rows(folder / f"{name}.csv", rows)
            if seconds:
                write_rows(folder / f"{name}-seconds.csv", seconds)
            write_whole(folder / f"{name}.md", _page(record))
            write_whole(folder / f"{name}-times.md", f"# {section.title}: times\n\n{times_text(record)}")
            write_json(folder / f"{name}.json", to_json(record) | {"job_seconds": result.job_seconds})
    for old in set(former.files if former else ()).difference(files):
        discard(folder / Path(old).name)
    return record


def read_record(folder: Path, name: str) -> Record | None:
    """What NAME.json holds; None where the experiment is not there with all its files."""
    from pydantic import TypeAdapter

    try:
        content = read_json(folder / f"{name}.json", "a result of `sonarmap reproduce`")
        record = TypeAdapter(Record).validate_python(content)
    except ValueError:  # not there, or not ours
        return None
    return record if all((folder / file).is_file() for file in record.files) else None


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as CSV, a column for every key in the order in which they first appear."""
    rows = list(rows)
    headings = list(dict.fromkeys(key for row in rows for key in row))
    write_csv(path, headings, ([row.get(key, "") for key in headings] for row in rows))


def times_text(record: Record) -> str:
    """Markdown of the times, and of the machine that took them."""
    tables = "".join(f"{table.markdown()}\n" for table in record.section.times)
    versions = record.provenance.versions.items()
    installed = ", ".join(f"{name} {version}" for name, version in versions if version and name != "system")
    return f"{tables}{record.jobs} jobs in {duration(record.seconds)} on {record.provenance.place}, with {installed}.\n"


def settings_table(record: Record) -> Table:
    """What the experiment was run with."""
    rows = tuple((name, json.dumps(value)) for name, value in record.provenance.settings.items())
    return Table("Settings", ("setting", "value"), rows)


def _page(record: Record) -> str:
    rows = f"[{record.name}.csv]({record.name}.csv)"
    times = f"[{record.name}-times.md]({record.name}-times.md)"
    made = f"Every row: {rows}. Times: {times}. Made by\n\n```sh\n{record.command}\n```\n"
    return f"{section_text(record.section)}\n{settings_table(record).markdown()}\n{made}"


def _copy_pictures(drawn: Path, folder: Path, name: str, section: Section) -> None:
    names = sorted(path.name for path in drawn.iterdir())
    well_named = all(picture.startswith(name) and picture.endswith(".png") for picture in names)
    if names != sorted(section.pictures) or not well_named:
        raise ValueError(f"{name} drew {names}, but its section needs {name}*.png: {[*section.pictures]}")
    for picture in names:
        write_whole(folder / picture, (drawn / picture).read_bytes())


def write_whole(path: Path, content: bytes | str) -> None:
    """Write a file or, where that fails, leave what was there."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content if isinstance(content, bytes) else content.encode())


class Verdict(NamedTuple):
    """One claim: the paper's value or the other methods', ours, and the verdict or what follows."""

    claim: str
    paper: str
    ours: str
    verdict: str


def verdicts(section: Section) -> tuple[Verdict, ...]:
    """The rows of the section's first table.

    It has columns whose headings begin with paper or others, with ours, and with verdict or what follows (otherwise a
    ValueError is raised); the cells left of them name the claim. A section without a table has no claims.
    """
    if not section.tables:
        return ()
    table = section.tables[0]
    columns = [_column(table, word) for word in ("paper|others", "ours", "verdict|what follows")]
    before = min(columns)
    return tuple(
        Verdict(", ".join(cell for cell in row[:before] if cell), *(row[k] for k in columns)) for row in table.rows
    )


def section_text(section: Section) -> str:
    """Markdown of a section without its times."""
    parts = [
        f"# {section.title}",
        *(table.markdown().strip() for table in section.tables),
        *(f"![{caption}]({name})\n\n*{caption}*" for name, caption in section.pictures.items()),
    ]
    return "\n\n".join(parts) + "\n"


def duration(seconds: float) -> str:
    """As in "41 s", "12 min" or "3 h 05 min"."""
    minutes = round(seconds / 60)
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def _column(table: Table, word: str) -> int:
    """The first column whose heading begins with the word, whatever follows it, as in "ours, worst series"."""
    columns = [k for k, heading in enumerate(table.headings) if re.match(rf"({word})\b", heading)]
    if not columns:
        raise ValueError(f"no heading of {table.title!r} begins with the word {word!r}: {table.headings}")
    return columns[0]
