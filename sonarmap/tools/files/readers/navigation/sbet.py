"""SBET, the trajectory of inertial systems by Applanix and others, with its standard deviations in SMRMSG.

Records of doubles, little-endian, without a header. The heading is that of the wander-azimuth frame: the true one is
the platform's heading less the wander angle.
"""

import re
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.instruments import COLUMNS, LEAST_SIGMA, PRIOR_SIGMAS
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.settings import OF_NMEA, OF_TABLES, NavigationSettings, local_places
from sonarmap.tools.files.time_scales import GPS_EPOCH, WEEK, gps_of_utc, utc_of_gps
from sonarmap.tools.files.user_file import naming, read_content

_NAMES = ("time", "lat", "lon", "alt", "vx", "vy", "vz", "roll", "pitch", "heading", "wander")
_RECORD = np.dtype([*((name, "<f8") for name in _NAMES), ("others", "<f8", 6)])
_ERROR_NAMES = ("time", "north", "east", "down", "vn", "ve", "vd", "roll", "pitch", "heading")
_ERRORS = np.dtype([(name, "<f8") for name in _ERROR_NAMES])
_RANGES = {
    "time": 2 * WEEK,
    "lat": np.pi / 2,
    "lon": np.pi,
    "alt": 1e5,
    "roll": np.pi,
    "pitch": np.pi / 2,
    "heading": 4 * np.pi,
    "wander": 2 * np.pi,
}
_MOST_ROWS = 200_000  # of a longer file every second row is read, or every third and so on
_TEXT = 1e-6  # text, read as doubles, is mostly smaller
_ON_EARTH = 1e8  # [s]: smaller stamps are not dates


def is_sbet(path: Path) -> bool:
    """Whether the first record is plausible."""
    if not path.is_file() or path.stat().st_size < _RECORD.itemsize:
        return False
    with path.open("rb") as file:
        record = np.frombuffer(file.read(_RECORD.itemsize), _RECORD)
    first = np.abs([record[name][0] for name in ("time", "lat", "lon")])
    return bool(_are_plausible(record).all() and (first > _TEXT).all())


def _are_plausible(records: np.ndarray) -> np.ndarray:
    return np.all([np.abs(records[name]) <= most for name, most in _RANGES.items()], axis=0) & (records["time"] >= 0)


def read_sbet(
    path: Path, settings: NavigationSettings, needs_sigmas: bool, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """The rows of an SBET file. `scans`: (N,) stamps of the scans [s], which tell the week."""
    settings.refuse_unused(path, "is an SBET file", OF_TABLES[1:] + OF_NMEA)
    content = read_content(path)
    count, rest = divmod(len(content), _RECORD.itemsize)
    records = np.frombuffer(content, _RECORD, count)
    usable = _are_plausible(records)
    if rest:
        notes.append(f"{path}: its last {rest} bytes are no whole record; the file was cut there")
    if not usable.all():
        notes.append(f"{path}: {int((~usable).sum())} of {count} records are damaged and left out")
    rows = np.flatnonzero(usable)
    rows = rows[:: 1 + len(rows) // _MOST_ROWS]
    records = records[rows]
    angles = np.degrees([records[name] for name in ("roll", "pitch", "heading", "lon", "lat")])
    angles[2] = np.degrees(records["heading"] - records["wander"]) % 360
    values, sigmas = np.column_stack([*angles, -records["alt"]]), _sigmas(path, records["time"])
    if needs_sigmas and np.isnan(sigmas).any() and not set(COLUMNS).issubset(settings.sigmas):
        raise InputError(f"{path} has no SMRMSG file beside it; give {PRIOR_SIGMAS}")
    notes.append(f"{path}: depths are its heights, above the ellipsoid, with the sign turned")
    with naming(path):
        values, georeference = local_places(values, True, settings, notes)
    times = _times(path, records["time"], settings, scans, notes)
    return NavigationLog("stamp", rows + 1, tuple(map(str, records["time"])), times, values, sigmas, georeference)


def _sigmas(path: Path, times: np.ndarray) -> np.ndarray:
    """(n, 6) standard deviations in the order of COLUMNS, from the SMRMSG file beside an SBET file; NaN without it."""
    names = (re.sub("sbet", "smrmsg", path.name, flags=re.IGNORECASE), f"{path.stem}.smrmsg", f"smrmsg_{path.stem}.out")
    beside = next(
        (path.with_name(name) for name in names if name != path.name and path.with_name(name).is_file()), None
    )
    if beside is None:
        return np.full((len(times), 6), np.nan)
    content = read_content(beside)
    errors = np.frombuffer(content, _ERRORS, len(content) // _ERRORS.itemsize)
    columns = [errors[name] / 60 for name in ("roll", "pitch", "heading")]  # from minutes of arc
    columns += [errors[name] for name in ("east", "north", "down")]
    steady = len(errors) > 0 and np.isfinite(columns).all() and (np.diff(errors["time"]) >= 0).all()
    if (
        not steady
        or not (np.array(columns) >= 0).all()
        or not errors["time"][0] - 1 <= times[0] <= errors["time"][-1] + 1
    ):
        raise InputError(f"{beside} is not the SMRMSG file of {path.name}; rename it, or export it again")
    return np.maximum(np.column_stack([np.interp(times, errors["time"], column) for column in columns]), LEAST_SIGMA)


def _times(
    path: Path, seconds: np.ndarray, settings: NavigationSettings, scans: np.ndarray, notes: list[str]
) -> np.ndarray:
    """UTC [s] of seconds of the GPS week, which is that of the scans, or that of --nav-offset."""
    if abs(settings.offset) >= WEEK or not len(scans):
        notes.append(f"{path}: times are seconds of a week, which --nav-offset or the scans tell")
        return seconds.copy()
    if np.median(scans) < _ON_EARTH:
        raise InputError(
            f"{path}: its times are seconds of a GPS week, and the scans have no dates; give the start of the week by "
            f"--nav-offset, which is {GPS_EPOCH:.0f} - 18 + 604800 times the number of the week"
        )
    is_utc = settings.time_scale == "utc"
    middle = float(np.median(scans if is_utc else gps_of_utc(scans))) - GPS_EPOCH * is_utc
    week = round((middle - float(np.median(seconds))) / WEEK)
    scale = "UTC" if is_utc else "GPS time (--time-scale utc if they are not)"
    notes.append(f"{path}: its week is taken to be GPS week {week}, as that of the scans; its times are {scale}")
    return week * WEEK + seconds + GPS_EPOCH if is_utc else utc_of_gps(week * WEEK + seconds)
