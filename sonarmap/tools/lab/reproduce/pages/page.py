"""One page on all experiments of a group, with pictures, such as docs/reproduction.md and docs/evaluation.md."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import all_or_none
from sonarmap.tools.lab.reproduce.experiments import ALL, EVALUATION, EVERY, KINDS, REAL, SCALE, SLAM, members
from sonarmap.tools.lab.reproduce.pages.folder import (
    Record,
    duration,
    read_record,
    section_text,
    times_text,
    verdicts,
    write_whole,
)
from sonarmap.tools.lab.reproduce.pages.introductions import INTRODUCTIONS
from sonarmap.tools.lab.reproduce.table import Table

# The file of each page among all pages -> its groups of experiments, the first of which gives its introduction
PAGES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "reproduction.md": (ALL,),
        "evaluation.md": (EVALUATION,),
        "kinds.md": (KINDS,),
        "survey.md": (SLAM, SCALE),
        "real.md": (REAL,),
    }
)


def write_page(path: Path, folder: Path, names: Sequence[str], group: str = ALL) -> list[Path]:
    """Write the page, as docs/reproduction.md, and, into a folder of its stem beside it, the pictures: all or none.

    It shows the experiments that are complete in the folder, in the order of the names, behind the introduction of the
    group. The page and the pictures are returned.

    Raises:
        InputError: no experiment is there, or a file cannot be written.
    """
    records = [record for name in names if (record := read_record(folder, name))]
    if not records:
        raise InputError(f"no complete experiment is in {folder}; run 'sonarmap reproduce NAME -o {folder}' first")
    pictures = [folder / name for record in records for name in record.section.pictures]
    copies = [path.parent / path.stem / picture.name for picture in pictures]
    with all_or_none():
        for picture, copy in zip(pictures, copies, strict=True):
            write_whole(copy, picture.read_bytes())
        write_whole(path, _page_text(records, f"{path.stem}/", group))
    return [path, *copies]


def write_pages(path: Path, folder: Path, group: str) -> list[Path]:
    """Write the page of a group; of EVERY, all pages that have results, into the folder `path`. All files are returned.

    Raises:
        InputError: no experiment is there, or a file cannot be written.
    """
    if group != EVERY:
        return write_page(path, folder, members(group), group)
    written = []
    for name, parts in PAGES.items():
        names = [member for part in parts for member in members(part)]
        if any(read_record(folder, member) for member in names):
            written += write_page(path / name, folder, names, parts[0])
    return written


def _page_text(records: Sequence[Record], pictures: str, group: str) -> str:
    """Of the records in their order; `pictures` stands before the pictures' file names."""
    group = group if group in INTRODUCTIONS else ALL
    values = ("claim", "paper", "ours", "verdict") if group == ALL else ("measure", "others", "ours", "what follows")
    claims = [(record.name, *verdict) for record in records for verdict in verdicts(record.section)]
    runs = [
        (record.name, str(record.jobs), duration(record.seconds), record.provenance.place, f"`{record.command}`")
        for record in records
    ]
    tables = (
        Table("All in short", ("experiment", *values), tuple(claims)),
        Table("Machines and times", ("experiment", "jobs", "time", "machine", "command"), tuple(runs)),
    )
    sections = [
        f"{section_text(record.section, 2, pictures)}\n### Times\n\n{times_text(record)}\nMade by\n\n"
        f"```sh\n{record.command}\n```\n"
        for record in records
    ]
    return "\n".join([INTRODUCTIONS[group], *(table.markdown() for table in tables), *sections])
