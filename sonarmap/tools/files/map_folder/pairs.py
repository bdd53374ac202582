"""Reads `pairs.csv`, the table of a map's pairs."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pair import Role
from sonarmap.tools.files.readers.csv_table import CsvTable, read_csv_table
from sonarmap.tools.files.readers.instruments import LARGEST
from sonarmap.tools.files.readers.navigation.rows import number
from sonarmap.tools.files.user_file import naming

CHAIN = "sequential"  # the role of consecutive scans; pairs of any other role are loops
POSE_COLUMNS = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")  # of T_target_source; empty where it failed
ANSWERS = {"yes": True, "no": False}
_COLUMNS = ("target", "source", "role", "kept", *POSE_COLUMNS)
_MOST_DEGREES = 180.0


@dataclass(frozen=True, slots=True)
class TriedPair:
    """A pair that was registered, and what became of it."""

    target: int  # target, source: indices of its scans
    source: int
    role: str  # what it was for, CHAIN or any other
    kept: bool  # whether the estimate uses it
    T_target_source: RigidTransform | None  # the registration's transform; None where it failed


def read_pairs(path: Path, scans: int) -> tuple[TriedPair, ...]:
    """The pairs of a table; columns that an evaluation does not need are ignored. `scans`: how many the survey has.
    Raises InputError: the file cannot be read; or a column is missing, or a cell cannot be used, naming the line."""
    table = read_csv_table(path)
    columns = _columns(table)
    table.require_even()
    read: list[tuple[int, int, str, bool]] = []
    poses = np.empty((len(table.rows), len(POSE_COLUMNS)))
    for k, row in enumerate(table.rows):
        cells = {name: row.cells[column] for name, column in columns.items()}
        with naming(table.where(row), "; fix that line, or map again"):
            target, source = (_scan(cells, column, scans) for column in ("target", "source"))
            role = _one_of(cells, "role", get_args(Role), f"one of {', '.join(get_args(Role))}")
            read.append((target, source, role, ANSWERS[_one_of(cells, "kept", ANSWERS, " or ".join(ANSWERS))]))
            # NaN, all of them, where all cells are empty
            is_bare = not any(cells[column] for column in POSE_COLUMNS)
            poses[k] = np.nan if is_bare else [_number(cells, column) for column in POSE_COLUMNS]
    known = ~np.isnan(poses[:, 0])
    # the angles are turned in the order yaw, pitch, roll
    R = Rotation.from_euler("ZYX", poses[known][:, :2:-1], degrees=True)
    transforms = iter(RigidTransform.from_components(poses[known, :3], R))
    return tuple(
        TriedPair(*pair, next(transforms) if registered else None)
        for pair, registered in zip(read, known.tolist(), strict=True)
    )


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


def _scan(cells: Mapping[str, str], column: str, scans: int) -> int:
    cell = cells[column]
    is_scan = cell.isascii() and cell.isdigit() and len(cell) < 10 and int(cell) < scans
    _require(is_scan, cells, column, f"the number of a scan, 0 to {scans - 1}")
    return int(cell)


def _one_of(cells: Mapping[str, str], column: str, known: Collection[str], wanted: str) -> str:
    _require(cells[column] in known, cells, column, wanted)
    return cells[column]


def _number(cells: Mapping[str, str], column: str) -> float:
    largest = _MOST_DEGREES if column.endswith("deg") else LARGEST
    value = number(cells[column])
    wanted = f"a number within {largest:g}, or all of {', '.join(POSE_COLUMNS)} empty"
    _require(abs(value) <= largest, cells, column, wanted)
    return value


def _require(is_right: bool, cells: Mapping[str, str], column: str, wanted: str) -> None:
    if not is_right:
        raise InputError(f"{column} is {cells[column][:40]!r}; wanted {wanted}")
