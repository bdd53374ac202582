"""SBET, the trajectory of inertial systems by Applanix and others, with its standard deviations in SMRMSG.

Records of doubles, little-endian, without a header. The true heading is the platform's less the wander angle.
"""

import re
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.instruments import COLUMNS, LEAST_SIGMA, PRIOR_SIGMAS
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.settings import OF_NMEA, OF_TABLES, NavigationSettings, local_places
from sonarmap.tools.files.time_scales import GPS_EPOCH, TIMES, WEEK, gps_of_utc, utc_of_gps
from sonarmap.tools.files.user_file import naming, read_content, reading

# Fields: time [s of the week], latitude, longitude [rad], height [m], 3 velocities, roll, pitch, heading, wander...
_FIELDS = 17
_USED = [0, 1, 2, 3, 7, 8, 9, 10]
_MOST = np.array([2 * WEEK, np.pi / 2, np.pi, 1e5, np.pi, np.pi / 2, 4 * np.pi, 2 * np.pi])  # of those used
_TEXT = 1e-6  # text, read as doubles, is mostly smaller
_ERRORS = 10  # fields of SMRMSG: time, North, East, down [m], 3 of velocity, roll, pitch, heading [minutes of arc]
_MOST_ROWS = 200_000  # of a longer file every second row is read, or every third and so on


def is_sbet(path: Path) -> bool:
    """Whether the first record is plausible."""
    if not path.is_file():
        return False
    with reading(path):
        first = np.fromfile(path, "<f8", _FIELDS)
    return len(first) == _FIELDS and bool(_are_plausible(first[None])[0] and (np.abs(first[:3]) > _TEXT).all())


def _are_plausible(records: np.ndarray) -> np.ndarray:
    return (np.abs(records[:, _USED]) <= _MOST).all(axis=1) & (records[:, 0] >= 0)


def read_sbet(
    path: Path, settings: NavigationSettings, needs_sigmas: bool, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """The rows of an SBET file. `scans`: (N,) stamps of the scans [s], which tell the week."""
    settings.refuse_unused(path, "is an SBET file", OF_TABLES[1:] + OF_NMEA)
    records, rest = _records(path, _FIELDS)
    usable = _are_plausible(records)
    if rest:
        notes.append(f"{path}: its last {rest} bytes are no whole record; the file was cut there")
    if not usable.all():
        notes.append(f"{path}: {int((~usable).sum())} of {len(records)} records are damaged and left out")
    rows = np.flatnonzero(usable)
    rows = rows[:: 1 + len(rows) // _MOST_ROWS]
    seconds, latitude, longitude, height, roll, pitch, heading, wander = records[rows][:, _USED].T
    angles = np.degrees([roll, pitch, (heading - wander) % (2 * np.pi), longitude, latitude])
    values, sigmas = np.column_stack([*angles, -height]), _sigmas(path, seconds)
    if needs_sigmas and np.isnan(sigmas).any() and not set(COLUMNS).issubset(settings.sigmas):
        raise InputError(f"{path} has no SMRMSG file beside it; give {PRIOR_SIGMAS}")
    notes.append(f"{path}: depths are its heights, above the ellipsoid, with the sign turned")
    with naming(path):
        values, georeference = local_places(values, True, settings, notes)
    times = _times(path, seconds, settings, scans, notes)
    return NavigationLog("stamp", rows + 1, tuple(map(str, seconds)), times, values, sigmas, georeference)


def _records(path: Path, fields: int) -> tuple[np.ndarray, int]:
    """(n, fields) doubles of the whole records, and the number of bytes behind them."""
    content = read_content(path)
    count, rest = divmod(len(content), 8 * fields)
    return np.frombuffer(content, "<f8", count * fields).reshape(count, fields), rest


def _sigmas(path: Path, times: np.ndarray) -> np.ndarray:
    """(n, 6) standard deviations in the order of COLUMNS, from the SMRMSG file beside an SBET file; NaN without it."""
    names = (re.sub("sbet", "smrmsg", path.name, flags=re.IGNORECASE), f"{path.stem}.smrmsg", f"smrmsg_{path.stem}.out")
    beside = [path.with_name(name) for name in names if name != path.name and path.with_name(name).is_file()]
    if not beside:
        return np.full((len(times), 6), np.nan)
    errors, _ = _records(beside[0], _ERRORS)
    own, columns = errors[:, 0], errors[:, [7, 8, 9, 2, 1, 3]] / [60, 60, 60, 1, 1, 1]
    fits = len(errors) and (np.diff(own) >= 0).all() and own[0] - 1 <= times[0] <= own[-1] + 1
    if not fits or not (np.isfinite(columns) & (columns >= 0)).all():
        raise InputError(f"{beside[0]} is not the SMRMSG file of {path.name}; rename it, or export it again")
    return np.maximum(np.column_stack([np.interp(times, own, column) for column in columns.T]), LEAST_SIGMA)


def _times(
    path: Path, seconds: np.ndarray, settings: NavigationSettings, scans: np.ndarray, notes: list[str]
) -> np.ndarray:
    """UTC [s] of seconds of the GPS week, which is that of the scans, or that of --nav-offset."""
    if abs(settings.offset) >= WEEK or not len(scans):
        notes.append(f"{path}: times are seconds of a week, which --nav-offset or the scans tell")
        return seconds.copy()
    if np.median(scans) < TIMES[0]:
        raise InputError(
            f"{path}: its times are seconds of a GPS week, and the scans have no dates; give the start of the week by "
            f"--nav-offset, which is {GPS_EPOCH:.0f} - 18 + 604800 times the number of the week"
        )
    is_utc = settings.time_scale == "utc"
    middle = float(np.median(scans - GPS_EPOCH if is_utc else gps_of_utc(scans)))
    week = round((middle - float(np.median(seconds))) / WEEK)
    scale = "UTC" if is_utc else "GPS time (--time-scale utc if they are not)"
    notes.append(f"{path}: its week is taken to be GPS week {week}, as that of the scans; its times are {scale}")
    return week * WEEK + seconds + GPS_EPOCH if is_utc else utc_of_gps(week * WEEK + seconds)
