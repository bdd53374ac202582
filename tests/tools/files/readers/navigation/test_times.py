"""Clocks and times of rows, against Python's calendar and IANA's table of leap seconds."""

from datetime import UTC, datetime, timedelta
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from sonarmap.tools.files.readers.navigation.why_apart import why_apart
from sonarmap.tools.files.time_scales import tai_minus_utc, utc_of_tai
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import START, read, require_words, scans_at

NTP = 2_208_988_800  # 1970 since 1900 [s]
GPS_SCANS = scans_at(START, START + 5)


def depths(path: Path, heading: str, times: list[str], **settings: object) -> np.ndarray:
    """(2,) depths at two scans; the rows' are 0, 1, 2, ... from START on, one a second."""
    text = f"{heading},Depth\n" + "".join(f"{time},{k}\n" for k, time in enumerate(times))
    values, *_ = read(path, text, NavigationSettings(**settings), GPS_SCANS)
    return values[:, 5]


def moments(form: str, count: int = 8, ahead: float = 0.0) -> list[str]:
    first = datetime.fromtimestamp(START, UTC) + timedelta(seconds=ahead)
    return [(first + timedelta(seconds=k)).strftime(form) for k in range(count)]


@pytest.mark.parametrize(
    ("heading", "times"),
    [
        ("Time", moments("%Y-%m-%dT%H:%M:%SZ")),
        ("Time", moments("%Y-%m-%d %H:%M:%S")),
        ("Time", moments("%d.%m.%Y %H:%M:%S")),
        ("Time", moments("%Y%m%dT%H%M%SZ")),
        ("Time", moments("%Y-%m-%dT%H:%M:%S+02:00", ahead=7200)),
        ("Time (UTC+2)", moments("%d.%m.%Y %H:%M:%S", ahead=7200)),
        ("Date,Time", moments("%d.%m.%Y,%H:%M:%S")),
        ("Date,UTC", moments("%Y-%m-%d,%H%M%S")),
        ("Date,Time", moments("%Y-%m-%d,%I:%M:%S %p")),
        ("Time", moments("%H:%M:%S")),  # of the scans' day
        ("Unix", [f"{START + k:.0f}" for k in range(8)]),
        ("Time", [f"{(START + k) * 1e3:.0f}" for k in range(8)]),
        ("Time", [f"{(START + k) * 1e9:.0f}" for k in range(8)]),
        ("Timestamp (ms)", [f"{(START + k) * 1e3:.0f}" for k in range(8)]),
        ("GPS Week,TOW (s)", [f"2425,{293400 + 18 + k}" for k in range(8)]),
    ],
)
def test_times_of_every_form_are_read(path: Path, heading: str, times: list[str]) -> None:
    np.testing.assert_allclose(depths(path, heading, times), [0, 5], atol=1e-3)


def test_dates_with_slashes_are_resolved_by_a_day_beyond_12(path: Path) -> None:
    day = 86_400
    scans = scans_at(START + 14 * day, START + 14 * day + 5)
    for form in ("%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S"):
        text = "Time,Depth\n" + "".join(f"{time},3\n" for time in moments(form, ahead=14 * day))
        assert (read(path, text, scans=scans)[0][:, 5] == 3).all()
    refuses("may be day/month or month/day", depths, path, "Time", moments("%d/%m/%Y %H:%M:%S"))


def test_gps_time_and_tai_are_converted_to_utc(path: Path) -> None:
    """2026-07-01 09:30:00 UTC is 09:30:18 in GPS time, second 293,418 of its week 2425, and 09:30:37 TAI."""
    seconds = 2425 * 604_800 + 293_418
    assert datetime(1980, 1, 6, tzinfo=UTC) + timedelta(seconds=seconds - 18) == datetime.fromtimestamp(START, UTC)
    late = [f"{START + 37 + k:.0f}" for k in range(8)]  # as PTP has it
    for times, settings in (
        ([f"{seconds + k}" for k in range(8)], {"time_scale": "gps"}),
        (moments("%Y-%m-%d %H:%M:%S", ahead=18), {"time_scale": "gps"}),
        (moments("%Y-%m-%d %H:%M:%S", ahead=37), {"time_scale": "tai"}),
        (late, {"time_scale": "tai"}),
        (late, {"offset": -37.0}),
    ):
        np.testing.assert_allclose(depths(path, "Time", times, **settings), [0, 5], atol=1e-3)


@pytest.mark.parametrize(
    ("heading", "times", "settings", "words"),
    [
        ("Time", ["noon"], {}, "line 2: the Time is 'noon'; wanted finite seconds"),
        ("Time", ["2026-13-01 10:00:00"], {}, "line 2"),
        ("Time", ["2026-07-01T09:30:00Z"], {"time_scale": "gps"}, "no zone with --time-scale gps"),
        ("Time", ["293418", "293419"], {"time_scale": "gps"}, "a column of GPS weeks"),
        ("Week,TOW", ["377,293418"], {}, "restarts every 1024"),
        ("Week,TOW", ["2425,5"], {"time_scale": "utc"}, "leave --time-scale utc out"),
    ],
)
def test_invalid_times_are_refused(path: Path, heading: str, times: list[str], settings: dict, words: str) -> None:
    require_words(path, [words], depths, path, heading, times, **settings)


def test_leap_seconds_equal_the_table_of_iana() -> None:
    table = resources.files("hypothesis").joinpath("vendor/leap-seconds.txt")
    lines = [line.split() for line in table.read_text().splitlines() if line.strip() and not line.startswith("#")]
    starts = np.array([int(line[0]) - NTP for line in lines], float)
    offsets = np.array([int(line[1]) for line in lines], float)
    np.testing.assert_array_equal(tai_minus_utc(starts), offsets)
    np.testing.assert_array_equal(tai_minus_utc(starts[1:] - 0.5), offsets[:-1])
    np.testing.assert_array_equal(utc_of_tai(starts + offsets), starts)
    np.testing.assert_array_equal(utc_of_tai(starts + offsets + 12.5), starts + 12.5)


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        (7200.0, "2 h ahead of UTC: --nav-offset=-7200"),
        (18.0, "GPS time, 18 s ahead of UTC: --time-scale gps"),
        (37.0, "TAI, 37 s ahead of UTC: --time-scale tai"),
        (18 - 315_964_800.0, "seconds since 1980"),
        (18 - 1_315_964_800.0, "GPS seconds less 1e9, as LAS files have: --nav-offset=1315964782"),
        (-5 * 86_400.0, "another day: --nav-offset=432000"),
    ],
)
def test_the_likely_cause_of_disjoint_times_is_named(shift: float, words: str) -> None:
    stamps = START + np.arange(0.0, 10.0)
    text = why_apart(stamps + shift, stamps)
    assert words in text
    assert f"{START + shift:.3f} s" in text
    assert "the scans from 1782898200.000 s (2026-07-01 09:30:00 UTC)" in text
    assert f"{abs(shift) - 9:.3f} s apart" in text


def test_numbered_scans_and_clocks_from_zero_are_named() -> None:
    counted, dated = np.arange(5.0), START + np.arange(5.0)
    assert "the scans are numbered" in why_apart(dated, counted)
    assert "does not count from 1970" in why_apart(counted, dated)
