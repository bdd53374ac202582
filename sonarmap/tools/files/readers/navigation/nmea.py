"""NMEA 0183 sentences: positions of GGA and RMC, headings of HDT and THS, dates of RMC and ZDA.

Other sentences, and text before the $ of a line, as a logger's time, are ignored. The first two letters of a sentence
name its talker: a receiver, a gyrocompass, the navigation of a vehicle beside a ship.
"""

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import reduce
from itertools import chain, combinations
from operator import xor
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.log import MOST_BETWEEN, NavigationLog, at_scans
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings, local_places
from sonarmap.tools.files.readers.navigation.times import DAY, dated, time_of_day
from sonarmap.tools.files.user_file import naming, reading

SENTENCE = re.compile(r"\$([A-Z]{2})([A-Z]{3})((?:,[^,*$\r\n]*)*)\*([0-9A-Fa-f]{2})")
_STARTS = re.compile(r"\$[A-Z]{5},")
_COUNTER = re.compile(r"(\d{2,3})(\d\d(?:\.\d*)?)")  # degrees and minutes
_USED = ("GGA", "RMC", "HDT", "THS", "ZDA")
# Kind of a fix by the quality of GGA or the mode of RMC; others are GNSS
_KINDS = {"2": "DGNSS", "4": "RTK", "5": "floating RTK", "D": "DGNSS", "R": "RTK", "F": "floating RTK"}
# Standard deviations by these kinds [m], and of the headings of a gyrocompass [deg]; from data sheets, rather too large
_SIGMAS = {"GNSS": 3.0, "DGNSS": 1.5, "RTK": 0.05, "floating RTK": 0.5}
_SIGMA_HEADING = 1.0
# Positions that no receiver measured, by the same
_NO_FIX = {"6": "estimated", "7": "manual", "8": "simulated", "E": "estimated", "M": "manual", "S": "simulated"}
_DEGREE = 111_195.0  # meters of latitude, on a sphere
_CONTRADICTED = 3.0  # [sigmas]: talkers whose median difference is larger are on different vehicles


@dataclass(frozen=True, slots=True)
class _Measurement:
    """The position or the heading in a sentence."""

    line: int
    talker: str
    sentence: str  # the three letters after the talker
    values: tuple[float, float, float]  # heading, longitude, latitude [deg]; NaN if not in the sentence
    kind: str = ""  # of a fix, a key of _SIGMAS; "" for a heading


_Row = tuple[_Measurement, float]  # and its time [s, UTC]


@dataclass(slots=True)
class _Sentences:
    """The sentences that were read."""

    talkers: tuple[str, ...]  # that are used; empty for all
    timed: list[tuple[int, float, float]] = field(default_factory=list)  # line, second of the day, Unix day or NaN
    measurements: list[_Measurement] = field(default_factory=list)
    unused: Counter[str] = field(default_factory=Counter)  # by sentence
    damaged: int = 0
    unfixed: int = 0  # without a fix, a heading or a time
    unmeasured: Counter[str] = field(default_factory=Counter)  # by the words of _NO_FIX


def read_nmea(path: Path, settings: NavigationSettings, scans: np.ndarray, notes: list[str]) -> NavigationLog:
    """Positions and headings of an NMEA file, with the settings' standard deviations or the usual ones of receivers and
    gyrocompasses. `scans`: (N,) stamps of the scans [s], for sentences without a date."""
    settings.refuse_unused(path, "holds NMEA sentences")
    read = _Sentences(settings.talkers)
    with reading(path), path.open(encoding="latin-1") as file:
        for number, line in enumerate(file, 1):
            _read_line(number, line, read)
    unmeasured = [f"{count} {kind}" for kind, count in sorted(read.unmeasured.items())]
    if not read.measurements or not read.timed:
        of = f" of {', '.join(read.talkers)} (--nmea-talker)" if read.talkers else ""
        raise InputError(
            f"{path} has no sentence{of} with a fix or a heading and a time ({read.damaged} have a wrong checksum, "
            f"{', '.join([f'{read.unfixed} are without a fix', *unmeasured])}); wanted GGA or RMC, and HDT"
        )
    if read.damaged:
        notes.append(f"{path}: {read.damaged} sentences have a wrong checksum or field and are left out")
    if read.unfixed:
        notes.append(f"{path}: {read.unfixed} sentences are without a fix, a heading or a time")
    if unmeasured:
        notes.append(f"{path}: places that no receiver measured are left out: {', '.join(unmeasured)}")
    return _log(path, read, settings, scans, notes)


def _read_line(number: int, line: str, read: _Sentences) -> None:
    matches = list(SENTENCE.finditer(line))
    whole = [match for match in matches if reduce(xor, match[0][1:-3].encode("latin-1"), 0) == int(match[4], 16)]
    read.damaged += max(len(_STARTS.findall(line)), len(matches)) - len(whole)
    for match in whole:
        talker, kind, fields = match[1], match[2], match[3].split(",")[1:]
        try:
            measurement = _measurement_of(number, kind, fields, read) if kind in _USED else None
        except (ValueError, IndexError, OverflowError):
            read.damaged += 1
            continue
        if kind not in _USED:
            read.unused[kind] += 1
        elif measurement is not None and read.talkers and talker not in read.talkers:
            read.unused[f"{talker}{kind}"] += 1
        elif measurement is not None:
            read.measurements.append(replace(measurement, talker=talker))


def _measurement_of(number: int, kind: str, fields: list[str], read: _Sentences) -> _Measurement | None:
    """The measurement of a sentence, with an empty talker; its time is added to `read`. Invalid fields raise
    ValueError, IndexError or OverflowError."""
    if kind in ("HDT", "THS"):
        is_valid = kind == "HDT" or fields[1] == "A"
        heading = float(fields[0] or np.nan)
        if is_valid and 0 <= heading <= 360:
            return _Measurement(number, "", kind, (heading, np.nan, np.nan))
        if is_valid and np.isfinite(heading):
            raise ValueError
        read.unfixed += 1
        return None
    if not fields[0]:
        read.unfixed += 1  # before the receiver knows the time
        return None
    of_day = time_of_day(fields[0])
    if of_day is None:
        raise ValueError
    day, measurement = np.nan, None
    if kind == "ZDA" and all(fields[1:4]):
        day = _day(int(fields[3]), int(fields[2]), int(fields[1]))
    if kind == "RMC" and fields[8]:
        date = fields[8]
        year = int(date[4:6])
        day = _day(year + (2000 if year < 80 else 1900), int(date[2:4]), int(date[:2]))
    if kind != "ZDA":
        measurement = _place(number, kind, fields, read)
    read.timed.append((number, of_day, day))
    return measurement


def _place(number: int, kind: str, fields: list[str], read: _Sentences) -> _Measurement | None:
    """The position of GGA or RMC; None without a fix."""
    k, quality = (1, fields[5]) if kind == "GGA" else (2, "".join(fields[11:12]))  # RMC has a mode since version 2.3
    if quality in _NO_FIX:
        read.unmeasured[_NO_FIX[quality]] += 1
    elif (quality in ("", "0")) if kind == "GGA" else (fields[1] != "A"):
        read.unfixed += 1
    else:
        latitude, longitude = _angle(fields[k], fields[k + 1], "NS"), _angle(fields[k + 2], fields[k + 3], "EW")
        return _Measurement(number, "", kind, (np.nan, longitude, latitude), _KINDS.get(quality, "GNSS"))
    return None


def _day(year: int, month: int, day: int) -> float:
    return datetime(year, month, day, tzinfo=UTC).timestamp() / DAY


def _angle(digits: str, half: str, halves: str) -> float:
    parts = _COUNTER.fullmatch(digits)
    if not parts or half not in halves or half == "" or float(parts[2]) >= 60:
        raise ValueError
    angle = int(parts[1]) + float(parts[2]) / 60
    if angle > (90 if halves == "NS" else 180):
        raise ValueError
    return angle if half == halves[0] else -angle


def _log(
    path: Path, read: _Sentences, settings: NavigationSettings, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """Rows of positions and of headings, each at its time."""
    timed = np.array(read.timed)
    # a heading has no time: it is interpolated by line between the sentences that have one
    times = np.interp([m.line for m in read.measurements], timed[:, 0], _dates(timed, path, scans, notes))
    rows = list(zip(read.measurements, times.tolist(), strict=True))
    count, talkers = len(rows), list(dict.fromkeys(m.talker for m in read.measurements))
    by_talker = {talker: _without_rmc([row for row in rows if row[0].talker == talker]) for talker in talkers}
    _refuse_contradictions(path, {talker: _arrays(own, settings) for talker, own in by_talker.items()})
    rows = _without_rmc(sorted(chain.from_iterable(by_talker.values()), key=lambda row: row[0].line))
    read.unused["places of RMC"] += count - len(rows)
    if unused := sorted((+read.unused).items()):
        notes.append(f"{path}: not used: {', '.join(f'{count} {kind}' for kind, count in unused)}")
    _say_sigmas(path, [m for m, _ in rows], settings, notes)
    (times, values, sigmas), georeference = _arrays(rows, settings), None
    if np.isfinite(values[:, 3]).any():
        with naming(path):
            values, georeference = local_places(values, True, settings, notes)
    lines, keys = np.array([m.line for m, _ in rows], np.int64), tuple(f"{time:.3f}" for time in times.tolist())
    return NavigationLog("stamp", lines, keys, times, values, sigmas, georeference)


def _without_rmc(rows: list[_Row]) -> list[_Row]:
    """The rows without positions of RMC at the time of a GGA, which tells more of a fix, or between two near ones."""
    gga = sorted(time for m, time in rows if m.sentence == "GGA")

    def is_beside(time: float) -> bool:
        before, after = bisect_right(gga, time) - 1, bisect_left(gga, time)
        return before >= 0 and after < len(gga) and gga[after] - gga[before] <= MOST_BETWEEN

    return [row for row in rows if row[0].sentence != "RMC" or not is_beside(row[1])]


def _arrays(rows: Sequence[_Row], settings: NavigationSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), and values and standard deviations (n, 6) as `NavigationLog` has them, with longitude and latitude
    [deg] in place of x and y."""
    values = np.full((len(rows), 6), np.nan)
    values[:, 2:5] = [m.values for m, _ in rows]
    return np.array([time for _, time in rows]), values, np.array([_sigmas(m, settings) for m, _ in rows])


def _sigmas(measurement: _Measurement, settings: NavigationSettings) -> list[float]:
    """(6,) standard deviations of a measurement, in the order of COLUMNS; NaN where it has no value."""
    if not measurement.kind:
        return [np.nan, np.nan, settings.sigmas.get("heading_deg", _SIGMA_HEADING), np.nan, np.nan, np.nan]
    sigma = settings.sigmas.get("x_m", _SIGMAS[measurement.kind])
    return [np.nan, np.nan, np.nan, sigma, sigma, np.nan]


def _say_sigmas(path: Path, kept: Sequence[_Measurement], settings: NavigationSettings, notes: list[str]) -> None:
    counts = Counter(m.kind for m in kept)
    if counts.pop("", 0):
        notes.append(
            f"{path}: its headings have no time; they are placed by their lines, between the sentences with times"
        )
        if "heading_deg" not in settings.sigmas:
            notes.append(
                f"{path}: standard deviations are taken to be heading {_SIGMA_HEADING:g} degrees (gyrocompass); "
                "--prior-sigmas gives others"
            )
    if counts and "x_m" not in settings.sigmas:
        parts = [f"{count} of {kind} ({_SIGMAS[kind]:g} m)" for kind, count in counts.items()]
        notes.append(f"{path}: fixes by their stated quality: {', '.join(parts)}; --prior-sigmas gives others")


def _refuse_contradictions(path: Path, logs: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Refuse two talkers that cannot be on one vehicle: their positions or headings differ by more than
    `_CONTRADICTED` standard deviations in the median. `logs`: {talker: result of `_arrays`}."""
    for (a, of_a), (b, (times, values, sigmas)) in combinations(logs.items(), 2):
        there, there_sigmas = at_scans(times, *of_a)
        off, sigma = there - values, np.hypot(there_sigmas, sigmas)
        off[:, 2] = (off[:, 2] + 180) % 360 - 180
        off[:, 3:5] *= _DEGREE * np.column_stack([np.cos(np.radians(values[:, 4])), np.ones(len(off))])
        for columns, what, unit in (([2], "headings", "degrees"), ([3, 4], "positions", "m")):
            apart = np.linalg.norm(off[:, columns], axis=1)
            both = np.isfinite(apart)
            if both.any() and np.median(apart[both] / sigma[both, columns[0]]) > _CONTRADICTED:
                raise InputError(
                    f"{path}: the {what} of its talkers {a} and {b} are {np.median(apart[both]):.3g} {unit} apart, in "
                    f"the median of {both.sum()}, as those of two vehicles are; choose the talkers to use, as in "
                    f"--nmea-talker {b} (several are separated by commas)"
                )


def _dates(timed: np.ndarray, path: Path, scans: np.ndarray, notes: list[str]) -> np.ndarray:
    """(n,) UTC [s] of sentences (n, 3): line, second of the day, and Unix day or NaN."""
    of_day, days = timed[:, 1], timed[:, 2]
    known = np.flatnonzero(np.isfinite(days))
    if not len(known):
        return dated(of_day, scans, path, notes)
    passed = np.cumsum(np.concatenate([[0.0], -np.round(np.diff(of_day) / DAY)]))  # midnights passed
    last = np.maximum.accumulate(np.where(np.isfinite(days), np.arange(len(days)), known[0]))
    return of_day + DAY * (days[last] + passed - passed[last])
