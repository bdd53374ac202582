"""Selection of input files: paths, folders and patterns of a command line to files in natural order."""

from __future__ import annotations

import glob
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.csv_table import PAIRS, SUMMARY
from sonarmap.tools.files.readers.instruments import PRIORS
from sonarmap.tools.files.user_file import read_json, require_file

BAG_METADATA, BAG_TITLE = "metadata.yaml", "rosbag2_bagfile_information"  # file in a ROS 2 bag folder, and its key
_BAG_FILES = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
_TABLES = (PRIORS, PAIRS)
_PART = re.compile(r"(.+?)(?:::(/?\w[\w/~-]*))?(?:#(\d{1,9}))?", re.ASCII | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Selection:
    """The selected files."""

    files: tuple[SelectedFile, ...]  # in natural order
    reordered: bool  # whether they were given in another order
    repeated: tuple[Path, ...] = ()  # files that more than one of the paths name
    passed_over: tuple[str, ...] = ()  # messages about files that were not selected: those of a map


@dataclass(frozen=True, slots=True)
class SelectedFile:
    """One file or ROS 2 bag to read."""

    path: Path
    index: int | None = None  # number of the only scan to read from it; None for all
    topic: str | None = None  # topic of a recording

    @property
    def place(self) -> str:
        """The path, with ::TOPIC if a topic was chosen, as a user writes it."""
        return f"{self.path}::{self.topic}" if self.topic else str(self.path)


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a ROS 2 bag (even one with damaged metadata), and not a folder of scans."""
    try:
        require_file(path / BAG_METADATA)
        with (path / BAG_METADATA).open("rb") as file:
            if BAG_TITLE.encode() in file.read(4096):
                return True
        return any(file.name.endswith(_BAG_FILES) for file in path.iterdir())
    except (OSError, InputError):
        return False


def part_of_file(text: str) -> SelectedFile | None:
    """The selection that FILE::TOPIC, FILE#3 or FILE::TOPIC#3 names; None if there is no such file."""
    parts = _PART.fullmatch(text)
    if parts is None or not (path := Path(parts[1])).exists() or (path.is_dir() and not is_bag_folder(path)):
        return None
    return SelectedFile(path, None if parts[3] is None else int(parts[3]), parts[2])


def select_files(paths: Sequence[str | Path], suffixes: Collection[str], not_scans: Collection[Path] = ()) -> Selection:
    """The files that `paths` name, each once, in natural order (scan2 before scan10). A path names a file
    (`recording.sonar#3` for its scan 3, counted from 0; `dive.bag::/sonar/points` for a topic), a ROS 2 bag, or a
    folder or pattern such as `scans/*.ply`, from which the files with one of the suffixes are taken, except priors.csv,
    pairs.csv and those in `not_scans`."""
    if not paths:
        raise InputError("no scans given; name files, folders or patterns such as scans/*.ply")
    chosen: dict[tuple[Path, int | None, str | None], SelectedFile] = {}
    skipped = {path.resolve() for path in not_scans}
    repeated: dict[Path, None] = {}
    for path in paths:
        for selected in sorted(_expand(str(path), suffixes, skipped), key=_order):
            same = (selected.path.resolve(), selected.index, selected.topic)
            if chosen.setdefault(same, selected) is not selected:
                repeated[chosen[same].path] = None
    as_given = list(chosen.values())
    files = sorted(as_given, key=_order)
    passed_over = list[str]()
    for folder in sorted({each.path.parent for each in files}):
        outputs = {path for path in _outputs(folder) if _is_scan(path, suffixes, ())} - {each.path for each in files}
        if listed := ", ".join(sorted(path.name for path in outputs)):
            passed_over.append(f"{folder} also holds a finished map, whose files are no scans: left out {listed}")
    return Selection(tuple(files), files != as_given, tuple(repeated), tuple(passed_over))


def _order(selected: SelectedFile) -> tuple[tuple[tuple[str, int], ...], int]:
    return natural_key(selected.place), selected.index or 0


def natural_key(text: str) -> tuple[tuple[str, int], ...]:
    """A sort key that compares numbers by value: scan2 before scan10."""
    pieces = re.findall(r"(\D*)(\d*)", text, re.ASCII)
    return tuple((letters.casefold(), int(digits[:4000] or -1)) for letters, digits in pieces)


def _expand(text: str, suffixes: Collection[str], skipped: Collection[Path]) -> list[SelectedFile]:
    path = Path(text)
    try:
        if path.is_dir() and not is_bag_folder(path):
            return _scans_among(path.iterdir(), suffixes, skipped, f"the folder {text}")
        if path.exists():
            return [SelectedFile(path)]
        if (part := part_of_file(text)) is not None:
            return [part]
        if glob.has_magic(text):
            matches = [Path(name) for name in glob.glob(text, recursive=True)]  # noqa: PTH207 (absolute patterns too)
            return _scans_among(matches, suffixes, skipped, f"the pattern {text}")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {text!r}: {error}. Check the path and its permissions") from error
    raise InputError(f"no such file or folder: {text}. Check the spelling; relative paths start from {Path.cwd()}")


def _scans_among(
    paths: Iterable[Path], suffixes: Collection[str], skipped: Collection[Path], where: str
) -> list[SelectedFile]:
    paths, named = list(paths), len(skipped)
    skipped = {*skipped, *(path.resolve() for parent in {path.parent for path in paths} for path in _outputs(parent))}
    files = [SelectedFile(path) for path in paths if _is_scan(path, suffixes, skipped)]
    if files:
        return files
    instead = ", but a finished map: give the scans that it was made of" if len(skipped) > named else ""
    raise InputError(
        f"{where} holds no scans{instead}; known formats are {', '.join(suffixes)}; subfolders are not read"
    )


def _outputs(folder: Path) -> list[Path]:
    """The files of the finished map in a folder and its exports, which its summary.json lists."""
    if not (folder / SUMMARY).is_file():
        return []
    try:
        names = read_json(folder / SUMMARY, "the summary.json of a map")["files"]
        return [folder / name for name in names if Path(name).name == name and (folder / name).is_file()]
    except (InputError, LookupError, TypeError):  # a summary.json that sonarmap did not write
        return []


def _is_scan(path: Path, suffixes: Collection[str], skipped: Collection[Path]) -> bool:
    is_file = path.suffix.lower() in suffixes and path.is_file() and path.name not in _TABLES
    return not path.name.startswith(".") and (is_file or is_bag_folder(path)) and path.resolve() not in skipped
