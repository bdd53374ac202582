"""Readers of ties, a person's verdicts on pairs of scans, and of control points, points in scans whose coordinates in
the world are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.control import ControlPoint, Use
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.tie import VERDICTS, Tie, Verdict
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference, on_the_earth
from sonarmap.tools.files.readers.csv_table import (
    CsvRow,
    CsvTable,
    degrees,
    number,
    number_within,
    read_csv_table,
    refuse,
)
from sonarmap.tools.files.readers.navigation.log import named_scan
from sonarmap.tools.files.readers.navigation.settings import rounded_origin
from sonarmap.tools.files.user_file import naming

NAMES = ("target", "source", "verdict")
POSE = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")
SIGMAS = ("sigma_m", "sigma_deg")
NOTE = "note"
TRANSFORM = (*POSE, *SIGMAS)
COLUMNS = (*NAMES, *TRANSFORM, NOTE)
_VERDICTS: dict[str, Verdict] = {verdict: verdict for verdict in VERDICTS}
# Bounds of the numbers in a tie [m, deg]; the smallest sigmas keep the information matrix well conditioned.
_LEAST = {"sigma_m": 1e-4, "sigma_deg": 1e-3}
_LARGEST = {"sigma_m": 1e4, "sigma_deg": 180.0} | dict.fromkeys(POSE[:3], 1e5) | dict.fromkeys(POSE[3:], 360.0)
POINT = ("x_m", "y_m", "z_m")
# Horizontal coordinates: a file has one of these pairs of columns
LOCAL, EARTH, GRID = ("east_m", "north_m"), ("lat_deg", "lon_deg"), ("easting_m", "northing_m")
UP = ("up_m", "height_m", "depth_m")
SPREADS = ("sigma_m", "sigma_h_m", "sigma_v_m")
USES: dict[str, Use] = {"control": "control", "check": "check"}
CONTROL_COLUMNS = ("name", "scan", *POINT, *LOCAL, *EARTH, *GRID, *UP, *SPREADS, "use")
DEFAULT_SIGMA = 0.05  # [m]
_SIGMA_BOUNDS = 1e-4, 1e4
_FARTHEST = 20_000.0  # local coordinates beyond this must be eastings and northings of a grid [m]
_COORDINATES = {"lat_deg": 90.0, "lon_deg": 180.0} | dict.fromkeys(GRID, 1e8)
_MOST = 1000  # control points per file; a survey has tens


def read_ties(path: Path, scans: Sequence[Scan]) -> tuple[Tie, ...]:
    """Read the ties of a CSV file with the columns target, source and verdict, and POSE and SIGMAS for transforms.

    A transform is T_target_source (angles as in docs/conventions.md), with one standard deviation for all three axes of
    translation and one for rotation. Lines that begin with # are comments. Ties are in the file's order; in each the
    scans are in the survey's order, for which a transform is inverted if necessary.
    """
    table = read_csv_table(path)
    columns = _columns(table)
    ties: list[Tie] = []
    lines: dict[tuple[int, int], int] = {}
    for row, (where, cells) in zip(table.rows, table.rows_by_name(columns), strict=True):
        tie = _tie(cells, scans, where)
        if tie.scans in lines:
            raise InputError(f"{path}: lines {lines[tie.scans]} and {row.line} have a verdict on one pair; delete one")
        lines[tie.scans] = row.line
        ties.append(tie)
    return tuple(ties)


def _columns(table: CsvTable) -> dict[str, int]:
    words = f"{', '.join(NAMES)}, and if need be {', '.join(COLUMNS[3:])}"
    columns = table.declared_columns(COLUMNS, NAMES, words, f"wanted {', '.join(NAMES)}; ")
    transform = [name for name in TRANSFORM if name in columns]
    missing = [name for name in TRANSFORM if name not in columns]
    if transform and missing:
        raise InputError(f"{table.where()}: a transform needs a column {missing[0]}; add it, or delete {transform[0]}")
    return columns


def _tie(cells: Mapping[str, str], scans: Sequence[Scan], where: str) -> Tie:
    target, source = (named_scan(scans, cells[name], f"{where}: {name}") for name in NAMES[:2])
    if target == source:
        raise InputError(f"{where}: it ties {scans[target].name} to itself; wanted two scans; fix that line")
    verdict = _VERDICTS.get(cells["verdict"].lower())
    if verdict is None:
        raise refuse(where, "verdict", cells["verdict"], f"one of {', '.join(VERDICTS)}")
    given = _transform(cells, where)
    if given is None:
        return Tie(min(target, source), max(target, source), verdict, note=cells.get(NOTE, ""))
    if verdict != "add":
        raise InputError(f"{where}: the verdict is {verdict}, and only add takes a transform; fix that line")
    # T_true = T Exp(xi) has the inverse T^-1 Exp(-Ad(T) xi)
    T_i_j, covariance = (given[0].inv(), propagated(*given)) if target > source else given
    measured = Registration(T_i_j, covariance, np.nan, np.nan, True, 0.0, "measured by hand")
    return Tie(min(target, source), max(target, source), verdict, measured, cells.get(NOTE, ""))


def _transform(cells: Mapping[str, str], where: str) -> tuple[RigidTransform, np.ndarray] | None:
    """T_target_source and its covariance (6, 6), rotation first [rad, m]; None if all cells are empty."""
    if not any(cells.get(name) for name in TRANSFORM):
        return None
    values: dict[str, float] = {}
    for name in TRANSFORM:
        bounds = _LEAST.get(name, -_LARGEST[name]), _LARGEST[name]
        wanted = f"a number from {bounds[0]:g} to {bounds[1]:g}, as the pair has a transform"
        values[name] = number_within(where, name, cells[name], bounds, wanted)
    R = Rotation.from_euler("ZYX", [values[name] for name in reversed(POSE[3:])], degrees=True)
    T = RigidTransform.from_components([values[name] for name in POSE[:3]], R)
    sigmas = np.repeat([np.radians(values["sigma_deg"]), values["sigma_m"]], 3)
    return T, np.diag(sigmas**2)


@dataclass(frozen=True, slots=True)
class Control:
    points: tuple[ControlPoint, ...]  # in the file's order, in the world frame of `georeference`
    georeference: Georeference | None  # of the world frame; None if its origin on the Earth is unknown
    notes: tuple[str, ...]  # messages for the user


def read_control(
    path: Path, scans: Sequence[Scan], georeference: Georeference | None = None, crs: str | None = None
) -> Control:
    """Read the control points of a CSV file with the columns name, scan, POINT (in that scan's sensor frame), LOCAL,
    EARTH or GRID, one of UP, and optionally SPREADS [m] and `use` (control or check). `georeference` is the map's; if
    it is None, the first point's rounded latitude and longitude become the origin. `crs` is that of GRID columns."""
    if georeference is not None and georeference.heading != 90.0:
        raise InputError("--origin-heading has no effect with control points, as x is East; leave it out")
    table = read_csv_table(path)
    columns, across, up = _control_columns(table)
    if (across == GRID) != (crs is not None):
        wrong = "--control-crs has no effect without the columns easting_m and northing_m; leave it out"
        if crs is None:
            wrong = "easting_m and northing_m need the CRS of their grid: give --control-crs, as EPSG:25832"
        raise InputError(f"{table.where()}: {wrong}")
    if not table.rows:
        raise InputError(f"{path} has no row below its heading; wanted a control point in each")
    if len(table.rows) > _MOST:
        raise InputError(f"{path} has {len(table.rows):,} control points; wanted at most {_MOST:,}; leave some out")
    points = [_point(cells, scans, (*across, up), where) for where, cells in table.rows_by_name(columns)]
    notes = list(table.notes)
    with naming(path):
        places, georeference = _local(np.array([point.known for point in points]), across, up, georeference, crs, notes)
    _refuse_twins(path, table.rows, points)
    placed = (replace(point, known=place) for point, place in zip(points, places, strict=True))
    return Control(tuple(placed), georeference, tuple(notes))


def _control_columns(table: CsvTable) -> tuple[dict[str, int], tuple[str, str], str]:
    """Index of each column, the pair of columns for East and North, and the column for Up."""
    columns = table.declared_columns(CONTROL_COLUMNS, ("name", "scan", *POINT), f"of {', '.join(CONTROL_COLUMNS)}")
    pairs = [pair for pair in (LOCAL, EARTH, GRID) if set(pair).intersection(columns)]
    if len(pairs) != 1 or not set(pairs[0]).issubset(columns):
        raise InputError(
            f"{table.where()}: wanted one of these pairs: {'; '.join(', '.join(pair) for pair in (LOCAL, EARTH, GRID))}"
        )
    ups = [name for name in UP if name in columns]
    if len(ups) != 1:
        raise InputError(f"{table.where()}: wanted one of the columns {', '.join(UP)}, and there are {len(ups)}")
    return columns, pairs[0], ups[0]


def _point(cells: Mapping[str, str], scans: Sequence[Scan], place: Sequence[str], where: str) -> ControlPoint:
    """The control point of a row, with `known` as the unconverted numbers of the columns `place`."""
    if not cells["name"]:
        raise InputError(f"{where}: the point has no name; fix that line")
    use = USES.get(cells.get("use", "").lower() or "control")
    if use is None:
        raise refuse(where, "use", cells["use"], " or ".join(USES))
    scan = named_scan(scans, cells["scan"], f"{where}: scan")
    point, known = (np.array([_number(name, cells[name], where) for name in names]) for names in (POINT, place))
    return ControlPoint(cells["name"], scan, point, known, _sigmas(cells, where), use)


def _number(name: str, cell: str, where: str) -> float:
    value = degrees(cell, name) if name in EARTH else number(cell)
    largest = _COORDINATES.get(name, _FARTHEST)
    if abs(value) <= largest:
        return value
    wanted = f"degrees within {largest:g}" if name in EARTH else f"meters within {largest:g}"
    if name in LOCAL and np.isfinite(value):
        wanted += "; coordinates of a grid go into easting_m and northing_m, with --control-crs"
    raise refuse(where, name, cell, wanted)


def _sigmas(cells: Mapping[str, str], where: str) -> np.ndarray:
    """Standard deviations (3,) along East, North and Up [m]."""
    wanted = f"a standard deviation from {_SIGMA_BOUNDS[0]:g} to {_SIGMA_BOUNDS[1]:g} m"
    given = {
        name: number_within(where, name, cells[name], _SIGMA_BOUNDS, wanted) for name in SPREADS if cells.get(name)
    }
    both = f"{SPREADS[1]} {{}} {SPREADS[2]}"
    if "sigma_m" in given and len(given) > 1:
        raise InputError(f"{where}: there are sigma_m and {both.format('or')}; wanted only one; fix that line")
    if len(given) == 1 and "sigma_m" not in given:
        raise InputError(f"{where}: {both.format('and')} can only be used together, and one is empty; fix that line")
    horizontal, vertical = (given.get(name, given.get("sigma_m", DEFAULT_SIGMA)) for name in SPREADS[1:])
    return np.array([horizontal, horizontal, vertical])


def _local(
    values: np.ndarray, across: tuple[str, str], up: str, georeference: Georeference | None, crs: str | None,
    notes: list[str],
) -> tuple[np.ndarray, Georeference | None]:  # fmt: skip
    """East, North and Up (n, 3) [m] relative to the map's origin, and the georeference of that origin."""
    height = 0.0 if georeference is None else georeference.height
    # height_m is relative to the vertical reference, up_m and depth_m to the map's origin
    ups = {"up_m": values[:, 2], "depth_m": -values[:, 2], "height_m": values[:, 2] - height}[up]
    if across == LOCAL:
        return np.column_stack([values[:, :2], ups]), georeference
    geodetic = np.column_stack([values[:, :2], ups + height])
    if across == GRID:
        geodetic = on_the_earth(geodetic, crs, "--control-crs")
    if georeference is None:
        georeference = rounded_origin(geodetic, "control point", notes)
    return np.column_stack([georeference.local(geodetic)[:, :2], ups]), georeference


def _refuse_twins(path: Path, rows: Sequence[CsvRow], points: Sequence[ControlPoint]) -> None:
    """Raise InputError if a point has two sets of world coordinates, or occurs twice in a scan."""
    first: dict[str, tuple[int, ControlPoint]] = {}
    in_scan: dict[tuple[str, int], int] = {}
    for row, point in zip(rows, points, strict=True):
        line, same = first.setdefault(point.name, (row.line, point))
        if (same.known != point.known).any():
            raise InputError(f"{path}: lines {line} and {row.line} give {point.name} different coordinates; fix one")
        if (twin := in_scan.setdefault((point.name, point.scan), row.line)) != row.line:
            raise InputError(f"{path}: lines {twin} and {row.line} have {point.name} in the same scan; delete one")
