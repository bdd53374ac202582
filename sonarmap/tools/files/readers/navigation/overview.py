"""A file of navigation, CSV, TUM or NMEA 0183, and what `sonarmap inspect` says of it."""

import codecs
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.checks import Clock, clock_of
from sonarmap.tools.files.readers.csv_table import read_csv_table
from sonarmap.tools.files.readers.instruments import COLUMNS, PRIOR_SIGMAS, values_of
from sonarmap.tools.files.readers.navigation.columns import MEASURED
from sonarmap.tools.files.readers.navigation.headings import column_of
from sonarmap.tools.files.readers.navigation.log import NavigationLog, RowFault, at_scans, usable_rows
from sonarmap.tools.files.readers.navigation.nmea import SENTENCE, read_nmea
from sonarmap.tools.files.readers.navigation.settings import OF_NMEA, OF_TABLES, UP_FRAMES, NavigationSettings
from sonarmap.tools.files.readers.navigation.table import read_table
from sonarmap.tools.files.readers.navigation.time_offset import why_apart
from sonarmap.tools.files.readers.poses.trajectory import read_tum
from sonarmap.tools.files.user_file import reading, require_file

_LOOKED_AT = 20_000  # bytes of a file's beginning that tell its kind
_TUM_NUMBERS = 8
_TABLES = (".csv", ".txt", ".log", ".tsv")
_POINT = {"x_m", "y_m", "z_m"}


def read_navigation(
    path: Path, settings: NavigationSettings, sigmas: Mapping[str, float] | None, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """The rows of a file, which is told by its content. `sigmas`: {column of COLUMNS: standard deviation} where the
    file has none; None where none is needed."""
    beginning = beginning_of(path)
    if SENTENCE.search(beginning):
        return read_nmea(path, settings, scans, notes)
    if path.suffix.lower() != ".tum" and not _is_tum(beginning):
        settings.refuse_unused(path, "holds no NMEA sentences", OF_NMEA)
        return read_table(path, settings, sigmas, scans, notes)
    if sigmas is not None and not set(COLUMNS).issubset(sigmas):
        raise InputError(f"{path} has no standard deviations; give {PRIOR_SIGMAS}")
    return _of_tum(path, settings)


def beginning_of(path: Path) -> str:
    """The first characters of a file, which tell its kind. Raises InputError: it cannot be read."""
    require_file(path)
    with reading(path), path.open("rb") as file:
        content = file.read(_LOOKED_AT)
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if wide else "utf-8", errors="replace")


def _is_tum(beginning: str) -> bool:
    """Whether the first line that is no comment is eight numbers between blanks."""
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
        warnings.simplefilter("ignore")  # of scipy: looking straight up or down a rotation has many headings and rolls
        values = values_of(trajectory.T_world_sensor)
    keys = tuple(f"{stamp:.3f}" for stamp in trajectory.stamps.tolist())
    lines = np.arange(1, len(trajectory.stamps) + 1)
    return NavigationLog("stamp", lines, keys, trajectory.stamps, values, np.full_like(values, np.nan), None)


@dataclass(frozen=True, slots=True)
class LogOverview:
    path: Path
    log: NavigationLog  # as it is read
    usable: NavigationLog  # without the rows that cannot be
    faults: tuple[RowFault, ...]
    clock: Clock | None  # of its rows in the file's order; None where rows have names
    scans: int  # how many it is looked at beside
    covered: dict[str, int]  # of how many of these it says something, by columns of COLUMNS
    apart: str  # why it says nothing of any of them, in words; "" where it does, or there are none
    notes: tuple[str, ...]

    @property
    def ranges(self) -> dict[str, tuple[int, float, float, float]]:
        """By columns of COLUMNS: in how many rows it is usable, the least, the median and the greatest."""
        told: dict[str, tuple[int, float, float, float]] = {}
        for name, column in zip(COLUMNS, self.usable.values.T, strict=True):
            known = column[np.isfinite(column)]
            if len(known):
                told[name] = len(known), float(known.min()), float(np.median(known)), float(known.max())
        return told

    @property
    def track(self) -> tuple[float, float, float] | None:
        """The way along the usable places [m], and the median and greatest speed between them [m/s]; None without."""
        known = np.isfinite(self.usable.values[:, 3:5]).all(axis=1) & np.isfinite(self.usable.times)
        order = np.argsort(self.usable.times[known], kind="stable")
        times, places = self.usable.times[known][order], self.usable.values[known, 3:5][order]
        steps, spans = np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(times)
        speeds = steps[spans > 0] / spans[spans > 0]
        return (float(steps.sum()), float(np.median(speeds)), float(speeds.max())) if len(speeds) else None


def is_log(path: Path) -> bool:
    """Whether a file is a log of navigation and no cloud of points: NMEA, TUM, or a table with times or names beside
    what instruments measure."""
    if not path.is_file():
        return False
    if path.suffix.lower() == ".tum":
        return True
    if path.suffix.lower() not in (*_TABLES, ".nmea", ".gps", ""):
        return False
    try:
        if SENTENCE.search(beginning_of(path)):
            return True
        heading = read_csv_table(path).heading.cells
    except InputError:
        return False
    known = {column.quantity for k, cell in enumerate(heading) if cell and (column := column_of(k, cell))}
    is_cloud = known >= _POINT and not known & {"roll_deg", "pitch_deg", "heading_deg", "yaw_deg"}
    return bool(known & {"stamp", "name", "date"}) and bool(known.intersection(MEASURED)) and not is_cloud


def log_overview(path: Path, settings: NavigationSettings, stamps: np.ndarray) -> LogOverview:
    """The log, beside scans at `stamps`, (N,) [s], of which there may be none. Raises InputError: it cannot be read."""
    notes: list[str] = []
    log = read_navigation(path, settings, None, stamps, notes)
    log = replace(log, times=log.times + (settings.offset or 0.0))
    usable, faults = usable_rows(log, settings.fastest)
    is_series, covered, apart = log.key == "stamp", dict[str, int](), ""
    if is_series and len(stamps):
        values, _ = at_scans(stamps, usable.times, usable.values, usable.sigmas)
        told = np.isfinite(values).sum(axis=0).tolist()
        covered = {name: count for name, count in zip(COLUMNS, told, strict=True) if count}
        apart = "" if covered else why_apart(log.times, stamps)
    clock = clock_of(log.times) if is_series else None
    return LogOverview(path, log, usable, tuple(faults), clock, len(stamps), covered, apart, tuple(notes))
