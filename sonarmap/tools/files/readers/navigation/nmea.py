"""NMEA 0183 sentences: positions, headings and attitude, and the strings of TSS1 motion sensors among them.

Text before the $ of a line, as a logger's time, is ignored. The first two letters of a sentence name its talker: a
receiver, a gyrocompass, the navigation of a vehicle beside a ship.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import reduce
from itertools import combinations
from operator import xor
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import DEGREE
from sonarmap.tools.files.readers.instruments import COLUMNS, LARGEST_OF
from sonarmap.tools.files.readers.navigation.log import (
    MOST_BETWEEN,
    SERIES,
    NavigationLog,
    at_scans,
    refuse_alternating,
)
from sonarmap.tools.files.readers.navigation.settings import OF_TABLES, NavigationSettings, local_places
from sonarmap.tools.files.readers.navigation.times import DAY, dated, time_of_day
from sonarmap.tools.files.user_file import naming, reading

_SENTENCE = re.compile(r"\$([A-Z]{2})([A-Z0-9]{2,5})((?:,[^,*$\r\n]*)*)(\*[0-9A-Fa-f]{2})?")
_TSS1 = re.compile(r":[0-9A-F]{6} [- ]?\d{4,5}([UuGgHhFf])([- +]?\d{4,5}) ?([- +]?\d{4,5})")
_COUNTER = re.compile(r"(\d{2,3})(\d\d(?:\.\d*)?)")  # degrees and minutes
# The fields of each sentence in their order. Of a position, a heading or an attitude at one time the first is used.
_FIELDS = {
    "GGA": "time lat lat_half lon lon_half quality",
    "GNS": "time lat lat_half lon lon_half quality",
    "RMC": "time status lat lat_half lon lon_half - - date variation variation_half quality",
    "GLL": "lat lat_half lon lon_half time status quality",
    "ZDA": "time day month year",
    "PASHR": "time heading - roll pitch - roll_sigma pitch_sigma heading_sigma",
    "HDT": "heading",
    "THS": "heading status",
    "PRDID": "pitch roll heading",
    "HDG": "magnetic deviation deviation_half variation variation_half",
    "HDM": "magnetic",
    "TSS1": "status roll pitch",
}
_NOT_USED = dict.fromkeys(("DBT", "DPT", "DBS", "DBK"), " (water below the transducer, not the sonar's depth)")
_MAGNETIC = " (magnetic; give --magnetic-declination)"
# Kind of a fix by the quality of GGA or the mode of other sentences, best first
_KINDS = {"4": "RTK", "R": "RTK", "5": "floating RTK", "F": "floating RTK", "2": "DGNSS", "D": "DGNSS"}
# Positions that no receiver measured, by the same
_NO_FIX = {"6": "estimated", "7": "manual", "8": "simulated", "E": "estimated", "M": "manual", "S": "simulated"}
# Standard deviations by the kind of a fix [m], and of angles [deg]; from data sheets, rather too large
_SIGMAS = {"GNSS": 3.0, "DGNSS": 1.5, "RTK": 0.05, "floating RTK": 0.5}
_ANGLES = {"roll": 0.5, "pitch": 0.5, "heading": 1.0, "magnetic": 3.0}
_ASSUMED = "roll and pitch 0.5 degrees, magnetic heading 3 degrees, heading 1 degrees (gyrocompass)"
_DAMAGED = "sentences have a wrong checksum or field and are left out"
_UNCHECKED = "sentences have no checksum, and are read without"
_UNFIXED = "sentences are without a fix, a heading or a time"
_LEAST_APART, _APART = 2.0, 1.5  # [m, sigmas] between two talkers whose positions alternate
_CONTRADICTED = 3.0  # [sigmas]: talkers whose median difference is larger are on different vehicles


@dataclass(slots=True)
class _Measurement:
    """What a sentence measured."""

    line: int
    talker: str
    sentence: str  # a key of _FIELDS
    kind: str  # of a fix, a key of _SIGMAS; "" for others
    values: np.ndarray  # (6,) in the order of COLUMNS, with longitude and latitude [deg] for x and y
    sigmas: np.ndarray  # (6,) in the same units, but meters of positions; NaN where not measured


@dataclass(slots=True)
class _Sentences:
    """The sentences that were read."""

    settings: NavigationSettings
    timed: list[tuple[int, float, float]] = field(default_factory=list)  # line, second of the day, Unix day or NaN
    measurements: list[_Measurement] = field(default_factory=list)
    unused: Counter[str] = field(default_factory=Counter)  # by sentence
    is_assumed: bool = False  # whether standard deviations of angles were
    counts: Counter[str] = field(default_factory=Counter)  # of sentences, by _DAMAGED, _UNCHECKED, _UNFIXED
    unmeasured: Counter[str] = field(default_factory=Counter)  # by the words of _NO_FIX
    variation: float = np.nan  # the last stated one [deg], East positive


def is_nmea(text: str) -> bool:
    """Whether there is a sentence with a checksum, or one that is known."""
    known = (match[4] or (_name(match) in _FIELDS and match[3]) for match in _SENTENCE.finditer(text))
    return any(known) or any(_TSS1.fullmatch(line.strip()) for line in text.splitlines())


def read_nmea(path: Path, settings: NavigationSettings, scans: np.ndarray, notes: list[str]) -> NavigationLog:
    """Positions, headings and attitude of an NMEA file, with the stated standard deviations, the settings', or
    the usual ones. `scans`: (N,) stamps of the scans [s], for sentences without a date."""
    read = _Sentences(settings)
    with reading(path), path.open(encoding="latin-1") as file:
        lines = [(number, *each) for number, line in enumerate(file, 1) for each in _sentences_of(line)]
    checked = {sentence[1:3] for sentence in lines if sentence[4]}
    for number, talker, sentence, fields, is_right in lines:
        if is_right or (is_right is None and (talker, sentence) not in checked):
            read.counts[_UNCHECKED] += is_right is None
            _take(number, talker, sentence, fields, read)
        else:
            read.counts[_DAMAGED] += 1
    is_magnetic = any(m.sentence in ("HDG", "HDM") for m in read.measurements)
    settings.refuse_unused(path, "holds NMEA sentences", OF_TABLES[: -1 if is_magnetic else None])
    if not read.measurements or not read.timed:
        of = f" of {', '.join(settings.talkers)} (--nmea-talker)" if settings.talkers else ""
        left_out = [each for counts in (read.counts, read.unmeasured, read.unused) for each in _counts(counts)]
        raise InputError(
            f"{path} has no sentence{of} with a fix or a heading and a time (not used: "
            f"{', '.join(left_out) or 'those without a time'}); wanted GGA, GNS, RMC or GLL, and HDT or PASHR"
        )
    notes += [f"{path}: {note}" for note in _counts(read.counts)]
    if read.unmeasured:
        notes.append(f"{path}: places that no receiver measured are left out: {', '.join(_counts(read.unmeasured))}")
    return _log(path, read, scans, notes)


def _counts(unused: Counter[str]) -> list[str]:
    return [f"{count} {kind}" for kind, count in sorted((+unused).items())]


def _sentences_of(line: str) -> list[tuple[str, str, list[str], bool | None]]:
    """Talker, sentence, fields, and whether the checksum is right (None without one) of the sentences in a line."""
    if match := _TSS1.search(line):
        is_settled, hundredths = match[1].isupper(), [match[2], match[3]]
        return [
            ("TS", "TSS1", ["VA"[is_settled], *(str(int(each.replace(" ", "")) / 100) for each in hundredths)], None)
        ]
    found = list[tuple[str, str, list[str], bool | None]]()
    for match in _SENTENCE.finditer(line):
        is_right = None if line[match.end() : match.end() + 1] != "*" else False
        if match[4]:
            is_right = reduce(xor, match[0][1:-3].encode("latin-1"), 0) == int(match[4][1:], 16)
        found.append((match[1], _name(match), match[3].split(",")[1:], is_right))
    return found


def _name(match: re.Match[str]) -> str:
    """The name of a sentence: proprietary ones have no talker."""
    return match[1] + match[2] if match[1].startswith("P") else match[2]


def _take(number: int, talker: str, sentence: str, fields: list[str], read: _Sentences) -> None:
    """Add a sentence to those that were read."""
    named = dict(zip(_FIELDS.get(sentence, "").split(), fields, strict=False))
    if sentence == "PASHR" and time_of_day(named.get("time", "")) is None:
        sentence = ",".join(["PASHR", *fields[:1]])  # others of that maker
    if sentence not in _FIELDS:
        read.unused[sentence + _NOT_USED.get(sentence, "")] += 1
        return
    try:
        if named.get("time", "-") == "":  # before the receiver knows it
            read.counts[_UNFIXED] += 1
            return
        if "time" in _FIELDS[sentence]:
            read.timed.append((number, *_time(named)))
        measurement = _measurement(number, talker, sentence, named, read)
    except (ValueError, LookupError, OverflowError):
        read.counts[_DAMAGED] += 1
        return
    if measurement is not None and read.settings.talkers and talker not in read.settings.talkers:
        read.unused[talker + sentence.removeprefix(talker)] += 1
    elif measurement is not None:
        read.measurements.append(measurement)


def _time(named: Mapping[str, str]) -> tuple[float, float]:
    """The second of the day, and the Unix day or NaN."""
    of_day, parts = time_of_day(named["time"]), [named.get(name, "") for name in ("year", "month", "day")]
    if of_day is None:
        raise ValueError
    if date := named.get("date"):
        parts = [f"{19 + (date[4:6] < '80')}{date[4:6]}", date[2:4], date[:2]]
    if not all(parts):
        return of_day, np.nan
    year, month, day = map(int, parts)
    return of_day, datetime(year, month, day, tzinfo=UTC).timestamp() / DAY


def _measurement(
    number: int, talker: str, sentence: str, named: Mapping[str, str], read: _Sentences
) -> _Measurement | None:
    """What a sentence measured; None without a fix, a heading or an attitude. Invalid fields raise ValueError or
    LookupError."""
    if named.get("variation"):
        read.variation = _angle(float(named["variation"]), named["variation_half"], "EW", 180)
    found = _Measurement(number, talker, sentence, "", np.full(6, np.nan), np.full(6, np.nan))
    if sentence == "ZDA":
        return None
    if named.get("status", "A") != "A":
        read.counts[_UNFIXED] += 1
        return None
    if "lat" in named:
        quality = set(named.get("quality") or "A" * ("status" in named)) - {"0", "N"}
        if quality and quality <= _NO_FIX.keys():
            read.unmeasured[_NO_FIX[min(quality)]] += 1
            return None
        if quality:
            found.kind = next((kind for letter, kind in _KINDS.items() if letter in quality), "GNSS")
            found.values[3:5] = _place(named, "lon", "EW", 180), _place(named, "lat", "NS", 90)
            found.sigmas[3:5] = read.settings.sigmas.get("x_m", _SIGMAS[found.kind])
    elif named.get("magnetic"):
        variation = read.variation if read.settings.declination is None else read.settings.declination
        if np.isnan(variation):
            read.unused[sentence + _MAGNETIC] += 1
            return None
        deviation = _angle(float(named.get("deviation") or 0), named.get("deviation_half") or "E", "EW", 180)
        _set_angle(found, "magnetic", (float(named["magnetic"]) + deviation + variation) % 360, "", read)
    else:
        for name in ("roll", "pitch", "heading"):
            if named.get(name):
                _set_angle(found, name, float(named[name]), named.get(f"{name}_sigma", ""), read)
    if np.isnan(found.values).all():
        read.counts[_UNFIXED] += 1
        return None
    return found


def _set_angle(found: _Measurement, name: str, angle: float, sigma: str, read: _Sentences) -> None:
    """Set an angle [deg], with the stated standard deviation, that of the settings, or the usual one."""
    column = min(list(_ANGLES).index(name), 2)
    if not abs(angle) <= LARGEST_OF[COLUMNS[column]] or (column == 2 and angle < 0):
        raise ValueError
    given = float(sigma) if sigma and float(sigma) > 0 else read.settings.sigmas.get(COLUMNS[column])
    found.values[column], found.sigmas[column] = angle, _ANGLES[name] if given is None else given
    read.is_assumed |= given is None


def _place(named: Mapping[str, str], name: str, halves: str, most: float) -> float:
    parts = _COUNTER.fullmatch(named[name])
    if not parts or float(parts[2]) >= 60:
        raise ValueError
    return _angle(int(parts[1]) + float(parts[2]) / 60, named[f"{name}_half"], halves, most)


def _angle(angle: float, half: str, halves: str, most: float) -> float:
    if half not in tuple(halves) or not 0 <= angle <= most:
        raise ValueError
    return angle if half == halves[0] else -angle


def _log(path: Path, read: _Sentences, scans: np.ndarray, notes: list[str]) -> NavigationLog:
    """Rows of positions, headings and attitudes, each at its time."""
    rows, timed, settings = read.measurements, np.array(read.timed), read.settings
    lines = np.array([row.line for row in rows], np.int64)
    # a sentence without a time is interpolated by line between those that have one
    times = np.interp(lines, timed[:, 0], _dates(timed, path, scans, notes))
    values, sigmas = _of_one_vehicle(path, rows, times, lines)
    for row, value in zip(rows, values, strict=True):
        read.unused[f"places of {row.sentence}"] += bool(np.isfinite(row.values[3]) and np.isnan(value[3]))
    kept = np.flatnonzero(np.isfinite(values).any(axis=1))
    if unused := _counts(read.unused):
        notes.append(f"{path}: not used: {', '.join(unused)}")
    _say_sigmas(path, [rows[k] for k in kept.tolist()], read, notes)
    times, values, sigmas, lines = times[kept], values[kept], sigmas[kept], lines[kept]
    georeference = None
    if np.isfinite(values[:, 3]).any():
        with naming(path):
            values, georeference = local_places(values, True, settings, notes)
    keys = tuple(f"{time:.3f}" for time in times.tolist())
    return NavigationLog("stamp", lines, keys, times, values, sigmas, georeference)


def _of_one_vehicle(
    path: Path, rows: list[_Measurement], times: np.ndarray, lines: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) values, each of one sentence at a time, and standard deviations. Refuses those of two receivers or
    vehicles."""
    values, sigmas = np.array([row.values for row in rows]), np.array([row.sigmas for row in rows])
    ranks, talkers = np.array([list(_FIELDS).index(row.sentence) for row in rows]), np.array([m.talker for m in rows])
    values = _first_ranks(times, np.array([row.sentence in ("HDG", "HDM") for row in rows]), values)
    logs: dict[str, tuple[np.ndarray, ...]] = {}
    for talker in dict.fromkeys(talkers.tolist()):
        own = talkers == talker
        values[own] = _first_ranks(times[own], ranks[own], values[own])
        refuse_alternating(path, times[own], _meters(values[own, 3:5], values[own, 4]), lines[own])
        logs[talker] = times[own], values[own], sigmas[own]
    _refuse_contradictions(path, logs)
    values = _first_ranks(times, ranks, values)
    if np.isfinite(values[:, 3]).any():
        least = max(_LEAST_APART, _APART * float(np.nanmedian(sigmas[:, 3])))
        refuse_alternating(path, times, _meters(values[:, 3:5], values[:, 4]), lines, least)
    return values, sigmas


def _meters(degrees: np.ndarray, latitudes: np.ndarray) -> np.ndarray:
    """(n, 2) East and North [m] of longitudes and latitudes, or differences of these, at `latitudes` (n,) [deg]."""
    return DEGREE * degrees * np.column_stack([np.cos(np.radians(latitudes)), np.ones(len(latitudes))])


def _first_ranks(times: np.ndarray, ranks: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, 6) values without those at the time of, or between two near ones of, a sentence that tells more: which is
    before it in _FIELDS."""
    values = values.copy()
    for columns in SERIES:
        known = np.isfinite(values[:, columns]).any(axis=1)
        for rank in np.unique(ranks[known])[1:]:
            rows, better = np.flatnonzero(known & (ranks == rank)), np.sort(times[known & (ranks < rank)])
            before = np.searchsorted(better, times[rows], side="right") - 1
            after = np.searchsorted(better, times[rows], side="left")
            inside = (before >= 0) & (after < len(better))
            near = better[np.minimum(after, len(better) - 1)] - better[before] <= MOST_BETWEEN
            values[np.ix_(rows[inside & near], columns)] = np.nan
    return values


def _say_sigmas(path: Path, kept: list[_Measurement], read: _Sentences, notes: list[str]) -> None:
    if any("time" not in _FIELDS[m.sentence] for m in kept):
        notes.append(f"{path}: angles without a time are placed by their lines, between the sentences with times")
    if read.is_assumed:
        notes.append(f"{path}: standard deviations are taken to be {_ASSUMED}; --prior-sigmas gives others")
    counts = Counter(m.kind for m in kept if m.kind)
    if counts and "x_m" not in read.settings.sigmas:
        parts = [f"{count} of {kind} ({_SIGMAS[kind]:g} m)" for kind, count in counts.items()]
        notes.append(f"{path}: fixes by their stated quality: {', '.join(parts)}; --prior-sigmas gives others")


def _refuse_contradictions(path: Path, logs: Mapping[str, tuple[np.ndarray, ...]]) -> None:
    """Refuse two talkers that cannot be on one vehicle: their positions or headings differ by more than
    `_CONTRADICTED` standard deviations in the median. `logs`: {talker: times, values and standard deviations}."""
    for (a, of_a), (b, (times, values, sigmas)) in combinations(logs.items(), 2):
        there, there_sigmas = at_scans(times, *of_a)
        off, sigma = there - values, np.hypot(there_sigmas, sigmas)
        off[:, 2] = (off[:, 2] + 180) % 360 - 180
        off[:, 3:5] = _meters(off[:, 3:5], values[:, 4])
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
