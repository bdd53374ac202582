"""Reading a navigation file (CSV, TUM, NMEA 0183, SBET, DVL, a recording), and its overview for `sonarmap inspect`."""

import codecs
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.bags.open import is_recording
from sonarmap.tools.files.readers.csv_table import CsvRow, CsvTable, degrees, number, numbers, read_csv_table, refuse
from sonarmap.tools.files.readers.instruments import (
    COLUMNS,
    LARGEST,
    LARGEST_OF,
    LEAST_SIGMA,
    MIN_ROWS,
    PRIOR_SIGMAS,
    SIGMA_COLUMNS,
    check_measured,
    values_of,
)
from sonarmap.tools.files.readers.navigation.columns import MEASURED, PAIRS, Columns, columns_of
from sonarmap.tools.files.readers.navigation.dvl import is_dvl, read_dvl
from sonarmap.tools.files.readers.navigation.faults import usable_rows
from sonarmap.tools.files.readers.navigation.headings import QUATERNION, SOURCES, column_of, is_unit
from sonarmap.tools.files.readers.navigation.log import NavigationLog, RowFault, at_scans, refuse_alternating
from sonarmap.tools.files.readers.navigation.nmea import is_nmea, read_nmea
from sonarmap.tools.files.readers.navigation.recorded import read_recorded_navigation
from sonarmap.tools.files.readers.navigation.sbet import is_sbet, read_sbet
from sonarmap.tools.files.readers.navigation.settings import (
    OF_NMEA,
    OF_TABLES,
    UP_FRAMES,
    NavigationSettings,
    local_places,
)
from sonarmap.tools.files.readers.navigation.times import TimeCells, times_of
from sonarmap.tools.files.readers.navigation.why_apart import why_apart
from sonarmap.tools.files.readers.selection import part_of_file
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.files.time_scales import Clock, clock_of
from sonarmap.tools.files.user_file import naming, reading, require_file

_LOOKED_AT = 20_000  # bytes at a file's beginning from which its kind is recognized
_TUM_NUMBERS = 8
_TABLES = (".csv", ".txt", ".log", ".tsv")
_SBET = (".sbet", ".out")
_POINT = {"x_m", "y_m", "z_m"}
_ON_EARTH = {"lat_deg": 90.0, "lon_deg": 180.0}
_WHOLE = _ON_EARTH | {"heading_deg": 360.0, "yaw_deg": 360.0}  # largest of each in degrees
_MOST_METERS = 1e7  # of a northing; larger numbers are 1e-7 degrees
_DEEP = 1000.0  # whole numbers of depths beyond are likely millimeters
_CONSTANTS = 4  # most different impossible values of a column, which stand for missing ones
_KINDS_OF = ("attitude", "attitude", "heading", "position", "position", "depth")
_KINDS = {name: kind for names, kind in zip(SOURCES, _KINDS_OF, strict=True) for name in names}
_DIGITS = 6  # least number of decimals of coordinates that look like degrees
_DEGREES_RANGE = 0.05  # [deg], about 5 km of latitude: coordinates in a smaller range look like degrees
_ABOVE = 0.5  # [m]: depths whose median is farther above the water have the wrong sign
_GRID = 20_000.0  # [m]: larger eastings and northings belong to a map grid


def read_navigation(
    path: Path, settings: NavigationSettings, sigmas: Mapping[str, float] | None, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """The rows of a file, whose kind is recognized by its content. `sigmas`: {column of COLUMNS: standard deviation}
    for columns without one in the file; None if none is needed."""
    part = part_of_file(str(path))
    if part is not None and is_recording(part.path):
        return read_recorded_navigation(part.path, part.topic, settings, sigmas, scans, notes)
    require_file(path)
    if is_sbet(path):
        return read_sbet(path, settings, sigmas is not None, scans, notes)
    beginning = beginning_of(path)
    if is_nmea(beginning):
        return read_nmea(path, settings, scans, notes)
    if is_dvl(beginning):
        return read_dvl(path, settings, sigmas is not None, notes)
    if path.suffix.lower() != ".tum" and not _is_tum(beginning):
        settings.refuse_unused(path, "holds no NMEA sentences", OF_NMEA)
        return read_table(path, settings, sigmas, scans, notes)
    if sigmas is not None and not set(COLUMNS).issubset(sigmas):
        raise InputError(f"{path} has no standard deviations; give {PRIOR_SIGMAS}")
    return _of_tum(path, settings)


def beginning_of(path: Path) -> str:
    """The first characters of a file, from which its kind is recognized."""
    require_file(path)
    with reading(path), path.open("rb") as file:
        content = file.read(_LOOKED_AT)
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if wide else "utf-8", errors="replace")


def _is_tum(beginning: str) -> bool:
    """Whether the first line that is not a comment has eight numbers separated by blanks."""
    lines = (line.strip() for line in beginning.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    try:
        return len([float(word) for word in first.split()]) == _TUM_NUMBERS
    except ValueError:
        return False


def _of_tum(path: Path, settings: NavigationSettings) -> NavigationLog:
    """A trajectory: T_world_vehicle, East-North-Up, x forward, y left, z up."""
    settings.refuse_unused(path, "is a TUM file", OF_TABLES + OF_NMEA, UP_FRAMES)
    trajectory = read_tum(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of SciPy: heading and roll are ambiguous at a pitch of 90 degrees
        values = values_of(trajectory.T_world_sensor)
    keys = tuple(f"{stamp:.3f}" for stamp in trajectory.stamps.tolist())
    lines = np.arange(1, len(trajectory.stamps) + 1)
    return NavigationLog("stamp", lines, keys, trajectory.stamps, values, np.full_like(values, np.nan), None)


@dataclass(frozen=True, slots=True)
class LogOverview:
    path: Path
    log: NavigationLog  # all rows
    usable: NavigationLog  # without faulty measurements
    faults: tuple[RowFault, ...]  # the faulty measurements
    clock: Clock | None  # of its rows in the file's order; None if rows have names
    scans: int  # number of scans that it is compared with
    covered: dict[str, int]  # by columns of COLUMNS, the number of these scans with a value
    apart: str  # why no scan has a value, in words; "" if some have one, or there are no scans
    notes: tuple[str, ...]

    @property
    def ranges(self) -> dict[str, tuple[int, float, float, float]]:
        """By columns of COLUMNS: number of rows with a usable value, minimum, median and maximum."""
        ranges: dict[str, tuple[int, float, float, float]] = {}
        for name, column in zip(COLUMNS, self.usable.values.T, strict=True):
            known = column[np.isfinite(column)]
            if len(known):
                ranges[name] = len(known), float(known.min()), float(np.median(known)), float(known.max())
        return ranges

    @property
    def track(self) -> tuple[float, float, float] | None:
        """Length of the usable track [m], and its median and largest speed [m/s]; None without two positions."""
        known = np.isfinite(self.usable.values[:, 3:5]).all(axis=1) & np.isfinite(self.usable.times)
        order = np.argsort(self.usable.times[known], kind="stable")
        times, places = self.usable.times[known][order], self.usable.values[known, 3:5][order]
        steps, spans = np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(times)
        speeds = steps[spans > 0] / spans[spans > 0]
        return (float(steps.sum()), float(np.median(speeds)), float(speeds.max())) if len(speeds) else None


def is_log(path: Path) -> bool:
    """Whether a file is a navigation log and not a point cloud: NMEA, TUM, or a table with times or scan names and
    columns of measurements."""
    if not path.is_file():
        return False
    if path.suffix.lower() == ".tum" or (path.suffix.lower() in _SBET and is_sbet(path)):
        return True
    if path.suffix.lower() not in (*_TABLES, ".nmea", ".gps", ".json", ".jsonl", ""):
        return False
    try:
        beginning = beginning_of(path)
        if is_nmea(beginning) or is_dvl(beginning):
            return True
        heading = read_csv_table(path).heading.cells
    except InputError:
        return False
    known = {column.quantity for k, cell in enumerate(heading) if cell and (column := column_of(k, cell))}
    is_cloud = known >= _POINT and not known & {"roll_deg", "pitch_deg", "heading_deg", "yaw_deg", "qw"}
    return bool(known & {"stamp", "name", "date"}) and bool(known.intersection(MEASURED)) and not is_cloud


def log_overview(path: Path, settings: NavigationSettings, stamps: np.ndarray) -> LogOverview:
    """The overview of a log, compared with scans at `stamps`, (N,) [s], N >= 0."""
    notes: list[str] = []
    log = read_navigation(path, settings, None, stamps, notes)
    log = replace(log, times=log.times + settings.offset)
    usable, faults = usable_rows(log, settings.fastest, stamps)
    is_series, covered, apart = log.key == "stamp", dict[str, int](), ""
    if is_series and len(stamps):
        values, _ = at_scans(stamps, usable.times, usable.values, usable.sigmas)
        counts = np.isfinite(values).sum(axis=0).tolist()
        covered = {name: count for name, count in zip(COLUMNS, counts, strict=True) if count}
        apart = "" if covered else why_apart(log.times, stamps)
    clock = clock_of(log.times) if is_series else None
    return LogOverview(path, log, usable, tuple(faults), clock, len(stamps), covered, apart, tuple(notes))


@dataclass(frozen=True, slots=True)
class _Table:
    """The rows of a CSV file; `columns` are those that are used."""

    path: Path
    columns: Columns
    rows: Sequence[CsvRow]
    cells: Mapping[str, list[str]]  # {quantity of a used column: its cell in each row}
    notes: list[str]
    faults: list[RowFault] = field(default_factory=list[RowFault])  # cells with an impossible value

    def where(self, row: int) -> str:
        return f"{self.path}: line {self.rows[row].line}"


def read_table(
    path: Path, settings: NavigationSettings, sigmas: Mapping[str, float] | None, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """The rows of a CSV file; arguments as of `read_navigation`."""
    raw = _with_units(read_csv_table(path))
    with naming(raw.where()):
        quantities = {column.quantity for k, cell in enumerate(raw.heading.cells) if (column := column_of(k, cell))}
        if settings.frame is None and quantities.issuperset(QUATERNION):
            settings = replace(settings, frame="enu")
            notes.append(
                f"{path}: axes are taken as East, North, up and forward, left, up, as in ROS; else give --nav-frame"
            )
        columns = columns_of(raw.heading.cells, settings, sigmas)
    for row in () if columns.is_own else raw.rows:  # extra empty cells at the end of a log's row are ignored
        while len(row.cells) > len(raw.heading.cells) and not row.cells[-1]:
            row.cells.pop()
    raw.require_even()
    cells = {name: [row.cells[column.index] for row in raw.rows] for name, column in columns.of.items()}
    table = _Table(path, columns, raw.rows, cells, notes)
    if not table.rows:
        raise InputError(f"{path} has no row below its heading; wanted one per scan")
    notes += [f"{path}: {note}" for note in columns.notes]
    notes += raw.notes
    values, georeference = _values(table, settings)
    deviations = _sigmas(table, settings)
    _check_rows(table, values, deviations, sigmas)
    _refuse_above_water(table, values[:, 5])
    times, keys = _times(table, settings, scans), tuple(cells[columns.key])
    lines = np.array([row.line for row in table.rows])
    refuse_alternating(path, times, values[:, 3:5], lines)
    written = {COLUMNS[k]: cells[name] for k, names in enumerate(SOURCES) for name in names if name in cells}
    return NavigationLog(
        columns.key, lines, keys, times, values, deviations, georeference, tuple(table.faults), written
    )


def _times(table: _Table, settings: NavigationSettings, scans: np.ndarray) -> np.ndarray:
    """(n,) UTC [s] of the rows; NaN where they have names."""
    keys, columns = table.cells[table.columns.key], table.columns
    for row, key in enumerate(keys):
        if not key:
            raise InputError(f"{table.where(row)}: its {columns.key} is empty; fix that line")
    if columns.key == "name":
        return np.full(len(keys), np.nan)
    lines, cells = np.array([row.line for row in table.rows]), table.cells
    stamps = TimeCells(table.path, lines, keys, columns.of["stamp"], cells.get("date"), cells.get("gps_week"))
    return times_of(stamps, settings.time_scale, scans, table.notes)


def _with_units(table: CsvTable) -> CsvTable:
    """The table with the units of a second line of headings in the first, as Depth (m)."""
    units = table.rows[0].cells if table.rows else []
    if len(units) != len(table.heading.cells) or not any(map(is_unit, units)):
        return table
    if any(np.isfinite(number(cell)) for cell in units):
        return table
    named = [
        f"{cell} ({unit.strip('()[] ')})" if is_unit(unit) else cell
        for cell, unit in zip(table.heading.cells, units, strict=True)
    ]
    return replace(table, heading=replace(table.heading, cells=named), rows=table.rows[1:])


def _values(table: _Table, settings: NavigationSettings) -> tuple[np.ndarray, Georeference | None]:
    """(n, 6) values in the order, units and signs of COLUMNS, NaN where not measured; the georeference, if known."""
    values = np.full((len(table.rows), len(COLUMNS)), np.nan)
    for k, names in enumerate(SOURCES):
        for name in names:
            if name in table.columns.of and name not in QUATERNION:
                values[:, k] = _column(table, name)
    if "qw" in table.columns.of:
        quaternions = np.stack([_column(table, name) for name in QUATERNION], axis=1)
        known = np.linalg.norm(quaternions, axis=1) > LEAST_SIGMA
        values[known, 2::-1] = Rotation.from_quat(quaternions[known]).as_euler("ZYX", degrees=True)
    elif len(values) >= MIN_ROWS and not table.columns.is_own and (values[:, :3] == 0).all():
        table.notes.append(
            f"{table.path}: roll, pitch and heading are 0 in all rows, as if not measured; they are left out"
        )
        values[:, :3] = np.nan
    if settings.points_up:
        values[:, 1] *= -1
    if "yaw_deg" in table.columns.of or "qw" in table.columns.of:
        values[:, 2] = np.mod(90 - values[:, 2], 360) if settings.points_up else np.mod(values[:, 2], 360)
    if settings.declination is not None:
        values[:, 2] = np.mod(values[:, 2] + settings.declination, 360)
    if "height_m" in table.columns.of or ("z_m" in table.columns.of and settings.frame in UP_FRAMES):
        values[:, 5] *= -1
    if "lat_deg" in table.columns.of or ("easting_m" in table.columns.of and settings.crs is not None):
        with naming(table.path):
            return local_places(values, "lat_deg" in table.columns.of, settings, table.notes)
    if "qw" not in table.columns.of:
        _refuse_degrees(table, values)
    if "easting_m" in table.columns.of:
        _refuse_grid(table, values)
    elif _is_north_first(table, settings):
        values[:, [3, 4]] = values[:, [4, 3]]
    return values, None


def _is_north_first(table: _Table, settings: NavigationSettings) -> bool:
    """Whether x is North, as in North, East, Down."""
    return "x_m" in table.columns.of and settings.frame is not None and not settings.points_up


def _column(table: _Table, name: str) -> np.ndarray:
    """(n,) values of one column in the unit of its quantity, NaN where its cell is empty or has an impossible value."""
    cells, column = table.cells[name], table.columns.of[name]
    values, bad = numbers(cells, table.columns.is_own)
    wanted = "a finite number, or an empty cell for what was not measured"
    if name in _ON_EARTH:
        values = np.array([degrees(cell, name) for cell in cells])
        bad, wanted = bad & np.isnan(values), "degrees, as 60.3913 or 60 23.478 N"
    for row in np.flatnonzero(bad).tolist():
        raise refuse(table.where(row), column.heading, cells[row], wanted)
    values *= column.factor * _whole_unit(table, name, values)
    quantity = "heading_deg" if name == "yaw_deg" else name
    most = _ON_EARTH.get(name, LARGEST_OF.get(quantity, LARGEST))
    wrong = (np.abs(values) > most) | ((name in SIGMA_COLUMNS) & (values < LEAST_SIGMA))
    if name == "heading_deg" and ((values > 180) & ~wrong).any():  # it counts from 0 to 360
        wrong |= values < 0
    rows = np.flatnonzero(wrong).tolist()
    if len(cells) >= MIN_ROWS and wrong.mean() <= 0.5 and len({cells[row] for row in rows}) <= _CONSTANTS:
        kind = _KINDS.get(name, "standard deviation")
        table.faults.extend(
            RowFault(table.rows[row].line, kind, f"{cells[row]}, which no instrument measures") for row in rows
        )
        values[wrong] = np.nan
    elif rows and name in _ON_EARTH:
        raise InputError(
            f"{table.where(rows[0])}: {column.heading} is {values[rows[0]]:g}; wanted degrees within {most:g}; if "
            "these are meters of a grid, give --nav-columns "
            f"{'northing_m' if name == 'lat_deg' else 'easting_m'}={column.heading} and --nav-crs"
        )
    for row in rows:
        with naming(table.where(row), "; fix that line"):
            check_measured(quantity, float(values[row]))
    return values


def _whole_unit(table: _Table, name: str, values: np.ndarray) -> float:
    """The unit of a column of whole numbers, as MAVLink has them, whose heading does not name it: 1e-7 degrees of
    latitude or longitude, 0.01 degrees of a heading; 1 for other numbers. Depths of thousands are refused."""
    column, known = table.columns.of[name], np.abs(values[np.isfinite(values)])
    if column.unit or column.is_own or not len(known) or (known % 1 != 0).any():
        return 1.0
    median = float(np.median(known))
    if name == "depth_m" and median > _DEEP:
        raise InputError(
            f"{table.path}: {column.heading} has whole numbers, {median:.0f} in the median; name the unit in the "
            f"heading, as {column.heading} (mm) or {column.heading} (m)"
        )
    unit = 1e-2
    if name in _ON_EARTH:
        places = [np.abs(numbers(table.cells[each], False)[0]) for each in _ON_EARTH]
        medians = [float(np.nanmedian(place)) for place in places if np.isfinite(place).any()]
        unit = 1e-7 if max(medians) > _MOST_METERS else 1.0
    if unit != 1 and name in _WHOLE and median > _WHOLE[name]:
        table.notes.append(
            f"{table.path}: {column.heading} is taken as whole numbers of {unit:g} degrees, as in MAVLink"
        )
        return unit
    return 1.0


def _sigmas(table: _Table, settings: NavigationSettings) -> np.ndarray:
    """(n, 6) standard deviations of the file, NaN where there is none."""
    sigmas = np.full((len(table.rows), len(COLUMNS)), np.nan)
    for k, name in enumerate(SIGMA_COLUMNS):
        if name in table.columns.of:
            sigmas[:, k] = _column(table, name)
    if _is_north_first(table, settings):
        sigmas[:, [3, 4]] = sigmas[:, [4, 3]]
    return sigmas


def _refuse_above_water(table: _Table, depths: np.ndarray) -> None:
    """Refuse a log whose depths are mostly above the water."""
    known = depths[np.isfinite(depths)]
    if not table.columns.is_own and "depth_m" in table.columns.of and len(known) and np.median(known) < -_ABOVE:
        heading = table.columns.heading("depth_m")
        raise InputError(
            f"{table.path}: {heading} is {np.median(known):.1f} m in the median, above the water; wanted depths, "
            f"positive down. If these are heights, give --nav-columns height_m={heading}; else turn the sign"
        )


def _check_rows(table: _Table, values: np.ndarray, deviations: np.ndarray, sigmas: Mapping[str, float] | None) -> None:
    """Refuse a value without a standard deviation, or (drop it in a log) one of a pair without the other."""
    measured = np.isfinite(values)
    for k, name in enumerate(COLUMNS if sigmas is not None else ()):
        bare = measured[:, k] & np.isnan(deviations[:, k]) & (name not in (sigmas or {}))
        if bare.any():
            raise InputError(
                f"{table.where(int(np.argmax(bare)))}: {name} has no standard deviation; fill in {SIGMA_COLUMNS[k]}"
            )
    for first, second in PAIRS:
        both = [COLUMNS.index(first), COLUMNS.index(second)]
        lone = measured[:, both].sum(axis=1) == 1
        if lone.any() and table.columns.is_own:
            raise InputError(f"{table.where(int(np.argmax(lone)))}: one of {first} and {second} is empty; fix it")
        values[np.ix_(lone, both)] = np.nan


def _refuse_degrees(table: _Table, values: np.ndarray) -> None:
    """Refuse coordinates in meters that look like degrees: with many decimals, and within a small range."""
    places = values[np.isfinite(values[:, 3:5]).all(axis=1), 3:5]
    if len(np.unique(places, axis=0)) < 3 or not (np.abs(places) <= [180, 90]).all():
        return
    names = [name for k in (3, 4) for name in SOURCES[k] if name in table.columns.of]
    fine = [cell for name in names for cell in table.cells[name] if len(cell.partition(".")[2]) >= _DIGITS]
    if np.ptp(places, axis=0).max() >= _DEGREES_RANGE or len(fine) < len(places) or np.abs(places).max() < 1:
        return
    raise InputError(f"{table.path}: {names[0]} and {names[1]} look like degrees; call them Longitude and Latitude")


def _refuse_grid(table: _Table, values: np.ndarray) -> None:
    """Refuse eastings and northings of a map grid without a CRS; small ones are meters from a local origin."""
    largest = np.nanmax(np.abs(values[:, 3:5]), initial=0.0)
    if largest > _GRID:
        both = " and ".join(table.columns.heading(name) for name in ("easting_m", "northing_m"))
        raise InputError(
            f"{table.path}: {both} reach {largest:.0f} m, as in a map grid; say which, as in --nav-crs EPSG:32632"
        )
    table.notes.append(f"{table.path}: eastings and northings are taken as meters from a local origin, by true North")
