"""File names in the folder that `sonarmap map` writes, the check that all are from one run, and pairs.csv.

summary.json is written last and has the SHA-256 of the others.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pair import Role
from sonarmap.tools.files.readers.csv_table import (
    PAIRS,
    SUMMARY,
    CsvTable,
    index_of,
    number_within,
    read_csv_table,
    refuse,
)
from sonarmap.tools.files.readers.instruments import LARGEST
from sonarmap.tools.files.user_file import read_json, sha256_of
from sonarmap.tools.files.writers.atomic import writing
from sonarmap.tools.files.writers.tables import write_json

OF_EACH = ("map{}.ply", "map{}.png", "trajectory{}.tum")  # files of each component; {} is its suffix
GRAPH, FULL_GRAPH = "graph.g2o", "graph.json"
OF_ALL = (GRAPH, FULL_GRAPH, PAIRS, SUMMARY)  # files about all components
TIMES, JOURNAL = "times.json", "journal.sqlite"
PICTURE = ".png"
REPORT = "report.html"  # written last, from the other files
OF_LINES = NAVIGATION, SOUNDINGS, LINES = "navigation.csv", "soundings.laz", "lines.json"  # maps of survey lines only
_MAP = re.compile(r"map(_all)?(_\d+)?(_survey_\d+)?\.ply")
_OF_PART = re.compile(_MAP.pattern + r"|map(_\d+)?\.png|trajectory(_\d+)?\.tum")
CHAIN = "sequential"  # role of pairs of consecutive scans; pairs of any other role are loop closures
POSE_COLUMNS = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")  # T_target_source; empty if it failed
ANSWERS = {"yes": True, "no": False}
_COLUMNS = ("target", "source", "role", "kept", *POSE_COLUMNS)
_MOST_DEGREES = 180.0


def side_car(name: str) -> str:
    """Name of the JSON file that describes the exported file `name`."""
    return f"{name}.json"


def require_apart(folder: Path, files: Iterable[Path]) -> None:
    """Raise InputError if a scan is the map of an earlier run, or the new map would overwrite it."""
    for path in files:
        if (_MAP.fullmatch(path.name) or path.name == PAIRS) and path.parent.resolve() == folder.resolve():
            raise InputError(f"{path} is among the scans and in the output folder; leave one out")


def earlier_files(folder: Path) -> set[str]:
    """Names of the component files and exports of an earlier run, from the folder's summary.json; empty without one."""
    try:
        names = set(read_json(folder / SUMMARY, "the summary.json of an earlier map")["files"])
        exported = {name for name in names if Path(name).name == name and side_car(name) in names}
        own = {name for name in names if _OF_PART.fullmatch(name) or name in (REPORT, *OF_LINES)}
        return own | exported | {side_car(name) for name in exported}
    except (ValueError, LookupError, TypeError):  # missing, or not written by sonarmap: nothing is removed
        return set()


@contextmanager
def as_written(folder: Path) -> Iterator[None]:
    """Turn errors in the block into an InputError: summary.json or graph.json hold values that `map` never writes."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
        where = f"{folder / SUMMARY} and {FULL_GRAPH}"
        raise InputError(f"{where} are not as `sonarmap map` writes them ({error!r}); map again") from error


def write_summary(folder: Path, summary: Mapping[str, Any], also: Iterable[str] = ()) -> None:
    """Write a map's summary.json, with the file names `also` added to its list of files."""
    files = dict.fromkeys([*summary.get("files", ()), *also])
    write_json(folder / SUMMARY, {**summary, "files": list(files)})


def checksums(written: Sequence[tuple[Path, Path]]) -> dict[str, dict[str, Any]]:
    """Size and SHA-256 by file name. `written`: (temporary path, final path) of each file, from `all_or_none`."""
    rows: dict[str, dict[str, Any]] = {}
    for temporary, path in written:
        with writing(path):
            rows[path.name] = {"bytes": temporary.stat().st_size, "sha256": sha256_of(temporary)}
    return rows


def require_own(folder: Path, summary: Mapping[str, Any], read: Iterable[str]) -> None:
    """Raise InputError if a file is not from the run that wrote summary.json: its size differs, or, for the files in
    `read`, its SHA-256. Maps of earlier versions have no checksums."""
    recorded, hashed = summary.get("checksums", {}), set(read)
    for name, row in recorded.items():
        path = folder / name
        if path.is_file() and (
            path.stat().st_size != row["bytes"] or (name in hashed and sha256_of(path) != row["sha256"])
        ):
            raise InputError(
                f"{path} does not belong to {SUMMARY} beside it: its size or SHA-256 differs. It was changed, or a "
                "run was killed while it wrote; run `sonarmap map` again, which continues where it stopped"
            )


@dataclass(frozen=True, slots=True)
class TriedPair:
    """A pair of scans that was registered, and whether it was kept."""

    target: int  # index of the target scan
    source: int  # index of the source scan
    role: str  # CHAIN, or a kind of loop closure
    kept: bool  # whether the estimate uses it
    T_target_source: RigidTransform | None  # the registered transform; None if registration failed


def read_pairs(path: Path, scans: int) -> tuple[TriedPair, ...]:
    """The pairs in a pairs.csv of a survey of `scans` scans; columns that an evaluation does not need are ignored."""
    table = read_csv_table(path)
    return tuple(_pair(cells, scans, where) for where, cells in table.rows_by_name(_columns(table)))


def _columns(table: CsvTable) -> dict[str, int]:
    """Index of each required column."""
    heading = table.heading.cells
    for name in _COLUMNS:
        if heading.count(name) != 1:
            raise InputError(
                f"{table.where()}: there are {heading.count(name)} columns {name}; wanted "
                f"the columns {', '.join(_COLUMNS)} once each, as `sonarmap map` writes them"
            )
    return {name: heading.index(name) for name in _COLUMNS}


def _pair(cells: Mapping[str, str], scans: int, where: str) -> TriedPair:
    indices = list[int]()
    for column in ("target", "source"):
        if (index := index_of(cells[column], scans)) is None:
            raise refuse(where, column, cells[column], f"the number of a scan, 0 to {scans - 1}")
        indices.append(index)
    for column, known in (("role", get_args(Role)), ("kept", ANSWERS)):
        if cells[column] not in known:
            raise refuse(where, column, cells[column], f"one of {', '.join(known)}")
    T_target_source = None
    if any(cells[column] for column in POSE_COLUMNS):
        x, y, z, roll, pitch, yaw = (_number(cells, column, where) for column in POSE_COLUMNS)
        R = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
        T_target_source = RigidTransform.from_components([x, y, z], R)
    return TriedPair(indices[0], indices[1], cells["role"], ANSWERS[cells["kept"]], T_target_source)


def _number(cells: Mapping[str, str], column: str, where: str) -> float:
    largest = _MOST_DEGREES if column.endswith("deg") else LARGEST
    wanted = f"a number within {largest:g}, or all of {', '.join(POSE_COLUMNS)} empty"
    return number_within(where, column, cells[column], (-largest, largest), wanted)
