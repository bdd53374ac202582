"""NMEA 0183 sentences: places of GGA or RMC, headings of HDT or THS, dates of RMC and ZDA.

Whatever stands before the $ of a line, as a logger's own time, is passed over, and so are all other sentences.
"""

import re
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.clocks.times import DAY, dated, time_of_day
from sonarmap.tools.files.readers.navigation.earth import local_places
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from sonarmap.tools.files.readers.navigation.usual import usual_of
from sonarmap.tools.files.user_file import naming, reading

SENTENCE = re.compile(r"\$([A-Z]{2})([A-Z]{3})((?:,[^,*$\r\n]*)*)\*([0-9A-Fa-f]{2})")
_STARTS = re.compile(r"\$[A-Z]{5},")
_COUNTER = re.compile(r"(\d{2,3})(\d\d(?:\.\d*)?)")  # degrees and minutes
_USED = ("GGA", "RMC", "HDT", "THS", "ZDA")
# What a fix of GGA is by its quality, as `usual` calls it; of other qualities GNSS.
_QUALITIES = {"2": "dgnss", "4": "rtk", "5": "rtkfloat"}


@dataclass(slots=True)
class _Sentences:
    """What was read so far: of each kind the lines, and what they say."""

    timed: list[tuple[int, float, float]] = field(default_factory=list)  # line, second of the day, Unix day or NaN
    # line, latitude, longitude [deg], and what it is as `usual` calls it
    places: dict[str, list[tuple[int, float, float, str]]] = field(default_factory=lambda: {"GGA": [], "RMC": []})
    headings: list[tuple[int, float]] = field(default_factory=list)
    left: Counter[str] = field(default_factory=Counter)
    damaged: int = 0
    unfixed: int = 0


def read_nmea(path: Path, settings: NavigationSettings, scans: np.ndarray, notes: list[str]) -> NavigationLog:
    """The places and headings of a file of sentences. `scans`: (N,) stamps of the scans [s], for sentences without a
    date. Raises InputError: it cannot be read, or has neither places nor headings at times."""
    settings.refuse_unused(path, "holds NMEA sentences")
    read = _Sentences()
    with reading(path), path.open(encoding="latin-1") as file:
        for number, line in enumerate(file, 1):
            _read_line(number, line, read)
    if not (any(read.places.values()) or read.headings) or not read.timed:
        raise InputError(
            f"{path} has no sentence with a fix or a heading and a time ({read.damaged} have a wrong checksum, "
            f"{read.unfixed} are without a fix); wanted GGA or RMC, and HDT"
        )
    _say(path, read, notes)
    return _log(path, read, settings, scans, notes)


def _read_line(number: int, line: str, read: _Sentences) -> None:
    matches = list(SENTENCE.finditer(line))
    whole = [match for match in matches if reduce(xor, match[0][1:-3].encode("latin-1"), 0) == int(match[4], 16)]
    read.damaged += max(len(_STARTS.findall(line)), len(matches)) - len(whole)
    for match in whole:
        kind, fields = match[2], match[3].split(",")[1:]
        if kind not in _USED:
            read.left[kind] += 1
            continue
        try:
            _take(number, kind, fields, read)
        except (ValueError, IndexError, OverflowError):
            read.damaged += 1


def _take(number: int, kind: str, fields: list[str], read: _Sentences) -> None:
    """One sentence; ValueError, IndexError or OverflowError where its fields are not as they should be."""
    if kind in ("HDT", "THS"):
        is_valid = kind == "HDT" or fields[1] == "A"
        heading = float(fields[0] or np.nan)
        if not (is_valid and np.isfinite(heading)):
            read.unfixed += 1
        elif 0 <= heading <= 360:
            read.headings.append((number, heading))
        else:
            raise ValueError
        return
    if not fields[0]:
        read.unfixed += 1  # before the receiver knows the time
        return
    of_day = time_of_day(fields[0])
    if of_day is None:
        raise ValueError
    day, place, kind_of_fix = np.nan, None, "gnss"
    if kind == "ZDA" and all(fields[1:4]):
        day = _day(int(fields[3]), int(fields[2]), int(fields[1]))
    if kind == "RMC" and fields[8]:
        date = fields[8]
        year = int(date[4:6])
        day = _day(year + (2000 if year < 80 else 1900), int(date[2:4]), int(date[:2]))
    if kind != "ZDA":
        is_fixed, k = (fields[5] not in ("", "0"), 1) if kind == "GGA" else (fields[1] == "A", 2)
        if kind == "GGA":
            kind_of_fix = _QUALITIES.get(fields[5], "gnss")
        if is_fixed:
            place = (_angle(fields[k], fields[k + 1], "NS"), _angle(fields[k + 2], fields[k + 3], "EW"))
        read.unfixed += not is_fixed
    read.timed.append((number, of_day, day))
    if place is not None:
        read.places[kind].append((number, *place, kind_of_fix))


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


def _say(path: Path, read: _Sentences, notes: list[str]) -> None:
    if read.damaged:
        notes.append(f"{path}: {read.damaged} sentences have a wrong checksum or field and are left out")
    if read.unfixed:
        notes.append(f"{path}: {read.unfixed} sentences are without a fix, a heading or a time")
    left = dict(read.left)
    if read.places["GGA"] and read.places["RMC"]:
        left["places of RMC"] = len(read.places["RMC"])
    if left:
        notes.append(f"{path}: not used: {', '.join(f'{count} {kind}' for kind, count in sorted(left.items()))}")


def _log(
    path: Path, read: _Sentences, settings: NavigationSettings, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """Rows of places and of headings, each at its time."""
    places = read.places["GGA"] or read.places["RMC"]
    timed = np.array(read.timed)
    times = _dates(timed, path, scans, notes)
    at = dict(zip(timed[:, 0].astype(int).tolist(), times.tolist(), strict=True))
    values = np.full((len(places) + len(read.headings), 6), np.nan)
    stamps = np.empty(len(values))
    lines = np.array([row[0] for row in (*places, *read.headings)], np.int64)
    sigmas = np.full_like(values, np.nan)
    usual = {kind: usual_of("x_m", [kind]) for *_, kind in places} if "x_m" not in (settings.sigmas or {}) else {}
    for k, (line, latitude, longitude, kind) in enumerate(places):
        values[k, 3:5], stamps[k] = (longitude, latitude), at[line]
        if (found := usual.get(kind)) is not None:
            sigmas[k, 3:5] = found[1]
    if usual:
        counts = Counter(kind for *_, kind in places)
        said = [f"{counts[kind]} of {found[0].name} ({found[1]:g} m)" for kind, found in usual.items() if found]
        notes.append(f"{path}: fixes by what the receiver says of them: {', '.join(said)}; --prior-sigmas gives others")
    if read.headings:
        values[len(places) :, 2] = [heading for _, heading in read.headings]
        # a heading has no time of its own: it is placed between the sentences that have one, by its line
        stamps[len(places) :] = np.interp(lines[len(places) :], timed[:, 0], times)
        notes.append(
            f"{path}: its headings have no time; they are placed by their lines, between the sentences with times"
        )
    georeference = None
    if places:
        with naming(path):
            values, georeference = local_places(values, True, settings, notes)
    order = np.argsort(lines, kind="stable")
    keys = tuple(f"{stamp:.3f}" for stamp in stamps[order].tolist())
    return NavigationLog("stamp", lines[order], keys, stamps[order], values[order], sigmas[order], georeference)


def _dates(timed: np.ndarray, path: Path, scans: np.ndarray, notes: list[str]) -> np.ndarray:
    """(n,) UTC [s] of sentences (n, 3): line, second of the day, and Unix day where it says one."""
    of_day, days = timed[:, 1], timed[:, 2]
    known = np.flatnonzero(np.isfinite(days))
    if not len(known):
        return dated(of_day, scans, path, notes)
    passed = np.cumsum(np.concatenate([[0.0], -np.round(np.diff(of_day) / DAY)]))  # midnights
    last = np.maximum.accumulate(np.where(np.isfinite(days), np.arange(len(days)), known[0]))
    return of_day + DAY * (days[last] + passed - passed[last])
