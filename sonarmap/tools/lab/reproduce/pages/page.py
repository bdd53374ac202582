"""One page on all experiments of a group, with pictures, such as docs/reproduction.md and docs/evaluation.md."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.lab.reproduce.experiments import ALL, EVALUATION, KINDS, REAL, SLAM
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
    """The text of a page around its experiments.

    Attributes:
        introduction: Markdown, with the page's title.
        beside: heading of the values next to ours: the paper's, or the required ones.
    """

    introduction: str
    beside: str


FRAMES: Mapping[str, Frame] = MappingProxyType(
    {
        ALL: Frame(PAPER_INTRODUCTION, "paper"),
        EVALUATION: Frame(EVALUATION_INTRODUCTION, "required"),
        SLAM: Frame(SLAM_INTRODUCTION, "required"),
        REAL: Frame(REAL_INTRODUCTION, "required"),
        KINDS: Frame(KINDS_INTRODUCTION, "required"),
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
    tables = [_verdict_table(records, frame.beside), _run_table(records)]
    return "\n".join([frame.introduction, *(table.markdown() for table in tables), *sections])


def _verdict_table(records: Sequence[Record], beside: str) -> Table:
    return Table(
        "All verdicts",
        ("experiment", "claim", beside, "ours", "verdict"),
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
            (
                record.name,
                str(record.jobs),
                duration(record.seconds),
                record.provenance.place,
                f"`{record.command}`",
            )
            for record in records
        ),
    )
