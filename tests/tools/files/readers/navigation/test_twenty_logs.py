"""Twenty logs as vehicles write them: rates, zones, units, gaps, empty cells, outliers; every row's fate is told."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.navigation.overview import is_log, log_overview
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.tools.files.readers.navigation.logs import START

COUNT = 200


@dataclass(frozen=True)
class Made:
    """A log, and what was done to it."""

    lines: list[str]
    settings: NavigationSettings
    empty: set[int]  # rows without a place
    wrong: set[int]  # rows whose place is far off
    frozen: set[int]  # rows that repeat the place before
    late: set[int]  # rows whose time is out of order


def made(number: int) -> Made:
    """A vehicle at about 1 m/s in circles; number chooses the rest."""
    rng = np.random.default_rng(number)
    rate = [0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0][number % 7]
    times = START + np.arange(COUNT) / rate
    if number % 3 == 1:
        times[120:] += 90.0 / rate  # a gap
    angle = (times - START) / 40.0
    east, north = 40 * np.sin(angle), 40 * np.cos(angle)
    east, north = east + rng.normal(0, 0.02 / rate, COUNT), north + rng.normal(0, 0.02 / rate, COUNT)
    depth = 15 + np.sin(angle / 3)
    empty, wrong, frozen, late = set[int](), set[int](), set[int](), set[int]()
    if number % 2:
        wrong = {40, 41, 90}
        east[[40, 41, 90]] += 400 / rate + 60
    if number % 5 == 2:
        empty = {10, 11, 150}
    if number % 5 == 3 and 1 <= rate <= 5:
        frozen = set(range(60, 60 + int(12 * rate)))
        east[59 : max(frozen) + 1], north[59 : max(frozen) + 1] = east[59], north[59]
    stamps = times.copy()
    if number % 4 == 3:
        late = {170}
        stamps[170] += 500.0
    if number % 4 == 1:
        stamps[130] = stamps[129]  # twice the same stamp: the first counts
    separator, comma = (";", True) if number % 6 == 5 else (",", False) if number % 6 < 4 else ("\t", False)
    headings = ["Time", "Easting", "Northing", "Depth (ft)" if number % 4 == 2 else "Depth", "Pings"]
    shown = depth / 0.3048 if number % 4 == 2 else depth

    def cell(value: float, digits: int = 4) -> str:
        return f"{value:.{digits}f}".replace(".", "," if comma else ".")

    def time(stamp: float) -> str:
        if number % 3 == 0:
            return f"{stamp:.3f}".replace(".", "," if comma else ".")
        zone = timezone(timedelta(hours=[0, 2, -7][number % 3]))
        moment = datetime.fromtimestamp(round(stamp, 3), UTC).astimezone(zone)
        return moment.isoformat(timespec="milliseconds")

    lines = [separator.join(headings)]
    for k in range(COUNT):
        place = ["", ""] if k in empty else [cell(east[k]), cell(north[k])]
        lines.append(separator.join([time(stamps[k]), *place, cell(shown[k]), str(k)]))
    return Made(lines, NavigationSettings(), empty, wrong, frozen, late)


@pytest.mark.parametrize("number", range(20))
def test_every_row_is_told(number: int, tmp_path: Path) -> None:
    given, path = made(number), tmp_path / f"log{number}.csv"
    path.write_text("\n".join([*given.lines, ""]))
    assert is_log(path)
    found = log_overview(path, given.settings, np.zeros(0))
    assert len(found.log.lines) == COUNT
    told = {(fault.line - 2, fault.kind) for fault in found.faults}
    expected = {(k, "position") for k in given.wrong | given.frozen} | {(k, "time") for k in given.late}
    assert told == expected
    rows, *_ = found.ranges["x_m"]
    assert rows == COUNT - len(given.empty | given.wrong | given.frozen | given.late)
    depths, least, _, most = found.ranges["depth_m"]
    assert depths == COUNT - len(given.late)
    assert 13.9 < least < most < 16.1
    assert any("'Pings'" in note for note in found.notes)
    assert found.clock is not None
    assert found.clock.gaps >= (number % 3 == 1)
