"""One page on all experiments of a group, with pictures, such as docs/reproduction.md and docs/evaluation.md."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.lab.reproduce.experiments import ALL, EVALUATION, EVERY, KINDS, REAL, SCALE, SLAM, members
from sonarmap.tools.lab.reproduce.pages.folder import Record, read_record, times_text
from sonarmap.tools.lab.reproduce.pages.introductions import (
    EVALUATION_INTRODUCTION,
    KINDS_INTRODUCTION,
    PAPER_INTRODUCTION,
    REAL_INTRODUCTION,
    SLAM_INTRODUCTION,
)
from sonarmap.tools.lab.reproduce.pages.section_text import duration, section_text, verdicts
from sonarmap.tools.lab.reproduce.table import Table


@dataclass(frozen=True, slots=True)
class Frame:
    """The text of a page around its experiments."""

    introduction: str  # Markdown, with the page's title
    # of the table of all claims: what they are, the values next to ours, ours, and what follows
    headings: tuple[str, str, str, str] = ("measure", "others", "ours", "what follows")


FRAMES: Mapping[str, Frame] = MappingProxyType(
    {
        ALL: Frame(PAPER_INTRODUCTION, ("claim", "paper", "ours", "verdict")),
        EVALUATION: Frame(EVALUATION_INTRODUCTION),
        SLAM: Frame(SLAM_INTRODUCTION),
        REAL: Frame(REAL_INTRODUCTION),
        KINDS: Frame(KINDS_INTRODUCTION),
    }
)


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


def write_page(path: Path, folder: Path, names: Sequence[str], frame: Frame = FRAMES[ALL]) -> list[Path]:
    """Write the page and, into a folder of its stem beside it, the pictures: all or none.

    Args:
        path: of the page, as docs/reproduction.md.
        folder: where the experiments' files are.
        names: of the experiments to look for, in order; those that are not complete there are left out.
        frame: what stands around them.

    Returns:
        the page, then the pictures.

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
            with atomic_path(copy) as temporary:
                temporary.write_bytes(picture.read_bytes())
        with atomic_path(path) as temporary:
            temporary.write_text(page_text(records, f"{path.stem}/", frame), encoding="utf-8")
    return [path, *copies]


def write_pages(path: Path, folder: Path, group: str) -> list[Path]:
    """Write the page of a group; of EVERY, all pages that have results, into the folder `path`.

    Returns:
        all pages and pictures.

    Raises:
        InputError: no experiment is there, or a file cannot be written.
    """
    if group != EVERY:
        return write_page(path, folder, members(group), FRAMES.get(group, FRAMES[ALL]))
    written = []
    for name, parts in PAGES.items():
        names = [member for part in parts for member in members(part)]
        if any(read_record(folder, member) for member in names):
            written += write_page(path / name, folder, names, FRAMES[parts[0]])
    return written


def page_text(records: Sequence[Record], pictures: str, frame: Frame = FRAMES[ALL]) -> str:
    """The page's Markdown.

    Args:
        records: of the experiments, in their order.
        pictures: what to put before the pictures' file names.
        frame: what stands around them.
    """
    sections = [
        f"{section_text(record.section, 2, pictures)}\n### Times\n\n{times_text(record)}\nMade by\n\n"
        f"```sh\n{record.command}\n```\n"
        for record in records
    ]
    tables = [_verdict_table(records, frame.headings), _run_table(records)]
    return "\n".join([frame.introduction, *(table.markdown() for table in tables), *sections])


def _verdict_table(records: Sequence[Record], headings: tuple[str, ...]) -> Table:
    return Table(
        "All in short",
        ("experiment", *headings),
        tuple(
            (record.name, verdict.claim, verdict.paper, verdict.ours, verdict.verdict)
            for record in records
            for verdict in verdicts(record.section)
        ),
    )


def _run_table(records: Sequence[Record]) -> Table:
    return Table(
        "Machines and times",
        ("experiment", "jobs", "time", "machine", "command"),
        tuple(
            (record.name, str(record.jobs), duration(record.seconds), record.provenance.place, f"`{record.command}`")
            for record in records
        ),
    )
