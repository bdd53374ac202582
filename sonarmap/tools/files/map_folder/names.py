"""The names of the files in the folder that `sonarmap map` writes, whether they are of one run, and pairs.csv.

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

OF_EACH = ("map{}.ply", "map{}.png", "trajectory{}.tum")  # with a place for the number of the component
GRAPH, FULL_GRAPH = "graph.g2o", "graph.json"
OF_ALL = (GRAPH, FULL_GRAPH, PAIRS, SUMMARY)  # the files of all components
TIMES, JOURNAL = "times.json", "journal.sqlite"
PICTURE = ".png"
REPORT = "report.html"  # written after the others, from them
OF_LINES = NAVIGATION, SOUNDINGS, LINES = "navigation.csv", "soundings.laz", "lines.json"  # of a map of lines of pings
_MAP = re.compile(r"map(_all)?(_\d+)?(_survey_\d+)?\.ply")
_OF_PART = re.compile(_MAP.pattern + r"|map(_\d+)?\.png|trajectory(_\d+)?\.tum")
CHAIN = "sequential"  # the role of consecutive scans; pairs of any other role are loops
POSE_COLUMNS = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")  # of T_target_source; empty where it failed
ANSWERS = {"yes": True, "no": False}
_COLUMNS = ("target", "source", "role", "kept", *POSE_COLUMNS)
_MOST_DEGREES = 180.0


def side_car(name: str) -> str:
    """The name of the file that says what an exported file of this name is."""
    return f"{name}.json"


def require_apart(folder: Path, files: Iterable[Path]) -> None:
    """Refuse scans that are the map of an earlier run, or would be overwritten by the new map."""
    for path in files:
        if (_MAP.fullmatch(path.name) or path.name == PAIRS) and path.parent.resolve() == folder.resolve():
            raise InputError(
                f"{path} is among the scans, but the map is written to {folder}: the file is of an earlier "
                "run, or would be overwritten. Leave it out, or choose another output folder."
            )


def earlier_files(folder: Path) -> set[str]:
    """The components' files of an earlier run in the folder, and what was exported of it, as its summary lists them;
    none without a summary."""
    try:
        names = set(read_json(folder / SUMMARY, "the summary.json of an earlier map")["files"])
        exported = {name for name in names if Path(name).name == name and side_car(name) in names}
        own = {name for name in names if _OF_PART.fullmatch(name) or name in (REPORT, *OF_LINES)}
        return own | exported | {side_car(name) for name in exported}
    except (ValueError, LookupError, TypeError):  # missing, or not ours: nothing is removed
        return set()


@contextmanager
def as_written(folder: Path) -> Iterator[None]:
    """Values that `map` does not write are the fault of summary.json or graph.json, not of who uses them."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
        where = f"{folder / SUMMARY} and {FULL_GRAPH}"
        raise InputError(f"{where} are not as `sonarmap map` writes them ({error!r}); map again") from error


def write_summary(folder: Path, summary: Mapping[str, Any], also: Iterable[str] = ()) -> None:
    """Write a map's summary.json, with the names of further files in its list."""
    files = dict.fromkeys([*summary.get("files", ()), *also])
    write_json(folder / SUMMARY, {**summary, "files": list(files)})


def checksums(written: Sequence[tuple[Path, Path]]) -> dict[str, dict[str, Any]]:
    """Size and SHA-256 of files, by name, as `all_or_none` gives them: the temporary path of each and its own."""
    rows: dict[str, dict[str, Any]] = {}
    for temporary, path in written:
        with writing(path):
            rows[path.name] = {"bytes": temporary.stat().st_size, "sha256": sha256_of(temporary)}
    return rows


def require_own(folder: Path, summary: Mapping[str, Any], read: Iterable[str]) -> None:
    """Refuse files of another run than summary.json's, by their sizes and, of those that are `read`, by their SHA-256.
    Maps of earlier versions have no checksums."""
    known, wanted = summary.get("checksums", {}), set(read)
    for name, row in known.items():
        path = folder / name
        if path.is_file() and (
            path.stat().st_size != row["bytes"] or (name in wanted and sha256_of(path) != row["sha256"])
        ):
            raise InputError(
                f"{path} does not belong to {SUMMARY} beside it: its size or SHA-256 is another. It was changed, or a "
                "run was killed while it wrote; run `sonarmap map` again, which continues from what is done"
            )


@dataclass(frozen=True, slots=True)
class TriedPair:
    """A pair that was registered, and what became of it."""

    target: int  # the index of a scan, as `source`
    source: int
    role: str  # what it was for, CHAIN or any other
    kept: bool  # whether the estimate uses it
    T_target_source: RigidTransform | None  # the registration's transform; None where it failed


def read_pairs(path: Path, scans: int) -> tuple[TriedPair, ...]:
    """The pairs of pairs.csv; columns that an evaluation does not need are ignored. `scans`: how many the survey
    has."""
    table = read_csv_table(path)
    return tuple(_pair(cells, scans, where) for where, cells in table.rows_by_name(_columns(table)))


def _columns(table: CsvTable) -> dict[str, int]:
    """Where the columns are that are needed."""
    heading = table.heading.cells
    for name in _COLUMNS:
        if heading.count(name) != 1:
            raise InputError(
                f"{table.where()}: the column {name} is there {heading.count(name)} times; wanted "
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
