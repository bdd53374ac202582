"""Conversion of a file's times to UTC: ISO 8601, dates and times of day, Unix, GPS time and TAI."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.csv_table import number, refuse
from sonarmap.tools.files.readers.instruments import LARGEST_STAMP
from sonarmap.tools.files.readers.navigation.headings import GPS_NAMES, Column, zone_of
from sonarmap.tools.files.time_scales import TAI_GPS, WEEK, TimeScale, utc_of_gps, utc_of_tai

# Largest stamp in a unit, and the unit [s]: seconds since 1970 are below 1e11 until 5138, milliseconds above since 1973
_SIZES = ((1e11, 1.0), (1e14, 1e-3), (1e17, 1e-6), (np.inf, 1e-9))
_ON_EARTH = 1e8  # [s]: smaller stamps are not dates but of a clock with its own start
DAY = 86_400.0
_DAYS_1970 = 25_569.0  # from 1899-12-30 to 1970-01-01
_DAYS = (32_874.0, 73_051.0)  # 1990 and 2100, from 1899-12-30
_MOST_DAYS = 0.01  # between most rows
_ROLLOVER = 1024  # weeks after which receivers count from 0 again
_TIME = re.compile(r"(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,](\d+))?)?\s*(?:([ap])\.?m\.?)?", re.IGNORECASE)
_DIGITS = re.compile(r"(\d\d)(\d\d)(\d\d)(\.\d*)?")
_DATE = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4})")
_AT = re.compile(r"(\S*[^\sT])[T\s]+(\d{1,2}:.*)")
_ZONE_BEHIND = re.compile(r"(?<!\s)\s*(?:UTC|GMT)$")  # the lookbehind keeps a run of blanks linear


@dataclass(frozen=True, slots=True)
class TimeCells:
    """The cells of a file's columns of times, one per row."""

    path: object  # of the file, for messages
    lines: np.ndarray  # (n,) line numbers of the rows
    stamps: Sequence[str]
    column: Column  # of the stamps
    dates: Sequence[str] | None = None  # None without a column of dates
    weeks: Sequence[str] | None = None  # GPS weeks; None without such a column

    def refuse(self, row: int, wanted: str) -> InputError:
        return refuse(f"{self.path}: line {self.lines[row]}", f"the {self.column.heading}", self.stamps[row], wanted)


def times_of(cells: TimeCells, scale: TimeScale | None, scans: np.ndarray, notes: list[str]) -> np.ndarray:
    """(n,) UTC [s] of the rows. `scale`: the user's choice; None for UTC, or GPS time if there are GPS weeks. `scans`:
    (N,) stamps of the scans [s], for times without a date."""
    if cells.column.word in GPS_NAMES and scale is None and cells.weeks is None:
        raise InputError(f"{cells.path}: {cells.column.heading!r} may be GPS time or UTC; say --time-scale gps or utc")
    values = np.array([number(cell) for cell in cells.stamps])
    if cells.weeks is not None:
        return _of_weeks(cells, values, cells.weeks, scale)
    if np.isfinite(values).all() and not (cells.dates and all(_DIGITS.fullmatch(cell) for cell in cells.stamps)):
        if cells.dates is not None:
            raise cells.refuse(0, "a time of day as 09:30:00 or 093000 beside the date")
        return _of_numbers(cells, values, scale, scans, notes)
    return _of_calendar(cells, scale or "utc", scans, notes)


def _of_numbers(
    cells: TimeCells, values: np.ndarray, scale: TimeScale | None, scans: np.ndarray, notes: list[str]
) -> np.ndarray:
    """UTC [s] of numbers since 1970, or 1980 for GPS, in seconds or, by their size, in milli-, micro-, nanoseconds; or
    of days since 1899-12-30, as spreadsheets count them."""
    if (np.abs(values) > LARGEST_STAMP).any():
        raise cells.refuse(int(np.argmax(np.abs(values))), "finite seconds")
    factor = cells.column.factor
    steps = np.abs(np.diff(values))
    are_days = ((values > _DAYS[0]) & (values < _DAYS[1])).all() and (steps[steps > 0] < _MOST_DAYS).mean() > 0.5
    if are_days and not cells.column.unit and not (len(scans) and np.median(scans) < _ON_EARTH):
        notes.append(f"{cells.path}: times are taken as days since 1899-12-30 in UTC, as spreadsheets count them")
        return (values - _DAYS_1970) * DAY
    if not cells.column.unit and not (len(scans) and np.abs(scans).max() > _SIZES[0][0]):  # else numbers of one kind
        size = int(np.searchsorted([limit for limit, _ in _SIZES], np.median(np.abs(values))))
        factor = _SIZES[size][1]
    seconds = values * factor
    if scale in (None, "utc"):
        return seconds
    if scale == "gps" and (np.abs(seconds) < WEEK).all():
        raise cells.refuse(0, "seconds since 1980, or a column of GPS weeks beside the seconds of the week")
    return utc_of_gps(seconds) if scale == "gps" else utc_of_tai(seconds)


def _of_weeks(cells: TimeCells, values: np.ndarray, weeks: Sequence[str], scale: TimeScale | None) -> np.ndarray:
    if scale not in (None, "gps"):
        raise InputError(f"{cells.path} has GPS weeks, which are GPS time; leave --time-scale {scale} out")
    numbers = np.array([number(cell) for cell in weeks])
    seconds = values * cells.column.factor
    usable = np.isfinite(numbers) & (numbers % 1 == 0) & (seconds >= 0) & (seconds <= WEEK)
    for row in np.flatnonzero(~usable).tolist():
        week = repr(weeks[row][:20])
        raise cells.refuse(row, f"seconds from 0 to {WEEK:.0f} in a GPS week, a whole number (here {week})")
    for row in np.flatnonzero((numbers < _ROLLOVER) | (numbers > 10_000)).tolist():
        week = repr(weeks[row][:20])
        raise cells.refuse(row, f"weeks counted from 1980 on, of four digits, not {week}, which restarts every 1024")
    return utc_of_gps(numbers * WEEK + seconds)


def _of_calendar(cells: TimeCells, scale: TimeScale, scans: np.ndarray, notes: list[str]) -> np.ndarray:
    """UTC [s] of dates and times of day in any of the usual forms."""
    texts = list(cells.stamps)
    if cells.dates is not None:
        texts = [f"{day} {time}" if day and time else "" for day, time in zip(cells.dates, texts, strict=True)]
    ahead = zone_of(cells.column.unit)
    split = [_AT.fullmatch(text) for text in texts]
    day_first = _day_first(cells, [match[1] if match else text for match, text in zip(split, texts, strict=True)])
    times, bare, dateless = np.zeros(len(texts)), 0, []
    for row, text in enumerate(texts):
        moment = _moment(text, day_first)
        if moment is None and (of_day := time_of_day(text)) is not None:
            dateless.append(row)
            times[row], bare = of_day - (ahead or 0.0), bare + (ahead is None)
        elif moment is None:
            raise cells.refuse(row, "finite seconds, or a time as 2026-07-01T09:30:00Z")
        elif moment.tzinfo is not None:
            if scale != "utc":
                raise cells.refuse(row, f"no zone with --time-scale {scale}, as times with a zone are UTC")
            times[row] = moment.timestamp()
        else:
            times[row] = moment.replace(tzinfo=UTC).timestamp() - (ahead or 0.0)
            bare += ahead is None
    if dateless:
        if len(dateless) < len(texts):
            raise cells.refuse(dateless[0], "a date too, as the other rows have")
        times = dated(times, scans, cells.path, notes)
    if bare and scale == "utc":
        notes.append(
            f"{cells.path}: times without a zone are taken as UTC; for a local clock give --nav-offset in seconds"
        )
    return times if scale == "utc" else utc_of_tai(times + (TAI_GPS if scale == "gps" else 0.0))


def _moment(text: str, day_first: bool) -> datetime | None:
    """The date and time of a text, or None."""
    text = _ZONE_BEHIND.sub("+00:00", text.strip())
    try:
        return datetime.fromisoformat(text.replace("/", "-").replace(",", ".") if text[:4].isdigit() else "")
    except (ValueError, OverflowError):
        pass
    split = _AT.fullmatch(text)
    parts = _DATE.fullmatch(split[1]) if split else None
    of_day = time_of_day(re.sub(r"(\+00:00|Z)$", "", split[2])) if split else None
    if of_day is None or split is None:
        return None
    try:
        if parts:
            day, month = (parts[1], parts[3]) if day_first or parts[2] == "." else (parts[3], parts[1])
            midnight = datetime(int(parts[4]), int(month), int(day))
        else:
            midnight = datetime.fromisoformat(split[1].replace("/", "-"))
        moment = midnight + timedelta(seconds=of_day)
    except (ValueError, OverflowError):
        return None
    return moment.replace(tzinfo=UTC) if split[2].endswith(("+00:00", "Z")) else moment


def _day_first(cells: TimeCells, dates: Sequence[str]) -> bool:
    """Whether dates with slashes are day/month/year."""
    parts = [match for text in dates if (match := _DATE.fullmatch(text)) and match[2] != "."]
    first, second = (any(int(match[k]) > 12 for match in parts) for k in (1, 3))
    if parts and first == second and any(match[1] != match[3] for match in parts):
        raise InputError(
            f"{cells.path}: line {cells.lines[0]}: {parts[0][0]!r} may be day/month or month/day; write 2026-07-01"
        )
    return first


def time_of_day(text: str) -> float | None:
    """Seconds of "9:30", "09:30:00.25", "9:30:00 PM" or "093000.25"; None for anything else."""
    text = text.strip()
    if digits := _DIGITS.fullmatch(text):
        hours, minutes, seconds = int(digits[1]), int(digits[2]), int(digits[3]) + float(f"0{digits[4] or ''}")
    elif clock := _TIME.fullmatch(text):
        hours, minutes, seconds = int(clock[1]), int(clock[2]), float(f"{clock[3] or 0}.{clock[4] or 0}")
        if clock[5]:
            if not 1 <= hours <= 12:
                return None
            hours = hours % 12 + 12 * (clock[5].lower() == "p")
    else:
        return None
    if hours > 23 or minutes > 59 or seconds >= 61:  # 60 is a leap second
        return None
    return hours * 3600.0 + minutes * 60 + seconds


def dated(of_day: np.ndarray, scans: np.ndarray, path: object, notes: list[str]) -> np.ndarray:
    """(n,) times [s] of seconds of the day, in the file's order, on the day that brings them nearest to the scans."""
    if len(scans) and np.median(scans) < _ON_EARTH:
        raise InputError(f"{path}: its times have no date, and neither have the scans; add a column of dates")
    days = np.cumsum(np.concatenate([[0.0], -np.round(np.diff(of_day) / DAY)]))  # midnights passed
    times = of_day + days * DAY
    if not len(scans):
        notes.append(f"{path}: its times have no date; the scans will tell it")
        return times
    middle = (float(scans.min()) + float(scans.max())) / 2
    day = np.round((middle - (times.min() + times.max()) / 2) / DAY)
    first = date(1970, 1, 1) + timedelta(days=int(day + days[0]))
    notes.append(f"{path}: its times have no date; the first is taken to be of {first}, as the scans are")
    return times + day * DAY
