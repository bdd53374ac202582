"""Clocks and times of rows, against Python's calendar and IANA's table of leap seconds."""

from datetime import UTC, datetime, timedelta
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from sonarmap.tools.files.readers.navigation.time_offset import estimate_offset, heading_rates, why_apart
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


def turning(rng: np.random.Generator, seconds: float = 600.0) -> tuple[np.ndarray, np.ndarray]:
    """Times at 50 Hz and turn rates [rad/s] of a vehicle that is steered at random: legs, turns and some yawing."""
    times = np.arange(0.0, seconds, 0.02)
    knots = np.arange(0.0, seconds + 8, 8.0)
    turns = np.where(rng.random(len(knots)) < 0.4, rng.normal(0, 0.15, len(knots)), 0.0)
    sway = 0.02 * np.interp(times, knots[::1], rng.normal(size=len(knots))) * np.sin(0.9 * times)
    return times, np.interp(times, knots, turns) + sway


def sampled(
    times: np.ndarray, rates: np.ndarray, step: float, noise: float, rng: np.random.Generator, first: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """What an instrument measures, every `step` seconds with some jitter."""
    at = np.arange(first, times[-1], step)
    at = np.sort(at + rng.uniform(-0.1, 0.1, len(at)) * step)
    return at, np.interp(at, times, rates) + rng.normal(0, noise, len(at))


@pytest.mark.parametrize("offset", [37.0, -18.0, 0.0, 3.21, -59.0])
@pytest.mark.parametrize("step", [0.1, 0.5])
def test_clock_offsets_are_estimated_from_turn_rates(offset: float, step: float) -> None:
    """A heading of 10 or 1 Hz beside an IMU of 20 Hz with a bias and another scale, within 0.1 s and 4 sigmas."""
    for seed in range(3):
        rng = np.random.default_rng([seed, int(10 * step), int(offset + 100)])
        times, rates = turning(rng)
        heading = np.cumsum(rates) * 0.02
        at = np.arange(20.0, 580.0, step)
        degrees = np.degrees(0.3 - np.interp(at, times, heading)) % 360 + rng.normal(0, 0.05, len(at))
        imu_times, imu_rates = sampled(times, 1.1 * rates + 0.01, 0.05, 0.01, rng)
        estimate = estimate_offset(*heading_rates(at - offset, degrees), imu_times, imu_rates)
        assert abs(estimate.seconds - offset) < 0.1
        assert abs(estimate.seconds - offset) < 5 * estimate.sigma + 0.01
        assert estimate.correlation > 0.5


def test_turn_rates_without_information_are_refused() -> None:
    rng = np.random.default_rng(5)
    times, rates = turning(rng)
    truth = sampled(times, rates, 0.1, 0.01, rng)
    still = np.full(6000, 0.3)
    grid = np.arange(6000) * 0.1
    noise = rng.normal(0, 0.1, 6000)
    circle = 0.2 * np.sin(2 * np.pi * grid / 20)
    for (a_times, a), (b_times, b), words in (
        ((grid, still), truth, "does not turn"),
        ((grid, 0 * still), (grid, 0 * still), "does not turn"),
        ((grid, noise), truth, "agree at no offset"),
        ((grid, circle), (grid + 7, circle), "nearly as well at"),
        ((grid, circle + noise / 30), (grid + 7, circle + noise[::-1] / 30), "nearly as well at"),
        ((grid[:100], truth[1][:100]), (grid[:100], truth[1][:100]), "less than 20 s in common"),
        ((grid[:2], still[:2]), truth, "three turn rates"),
        ((grid[::-1], still), truth, "ascend"),
        ((np.array([0.0, 0.1, 0.2, 1e12]), still[:4]), truth, "span 11574074 days, or have a jump"),
        ((np.array([0.0, 1.0, 2.0, 26 * 86_400.0]), still[:4]), truth, "span 26 days, or have a jump"),
    ):
        refuses(f"offset cannot be estimated: .*{words}.*--nav-offset", estimate_offset, a_times, a, b_times, b)


def test_navigation_is_moved_to_the_scans_clock(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    times, rates = turning(rng, 300)
    heading = np.degrees(1 - np.cumsum(rates) * 0.02) % 360
    rows = "".join(f"{START + t - 37:.3f},{h:.4f}\n" for t, h in zip(times[::10].tolist(), heading[::10], strict=True))
    scans = scans_at(START + 100, START + 150)
    notes: list[str] = []
    (tmp_path / "log.csv").write_text("Time,Heading\n" + rows)
    settings = NavigationSettings(offset=None, sigmas={"heading_deg": 1.0})
    imu = (START + times[::5], rates[::5] + rng.normal(0, 0.01, len(times[::5])))
    navigated = navigate(scans, tmp_path / "log.csv", settings, notes=notes, turn_rates=imu)
    assert any("37.0" in note and "by the turn rates" in note for note in notes)
    values, *_ = read(tmp_path / "log.csv", "Time,Heading\n" + rows, NavigationSettings(offset=37.0), scans)
    for scan, value in zip(navigated.scans, values[:, 2], strict=True):
        assert scan.prior is not None
        yaw = scan.prior.T_world_sensor.rotation.as_euler("ZYX", degrees=True)[0]
        assert (90 - yaw - value + 180) % 360 - 180 == pytest.approx(0, abs=0.5)
    refuses("--nav-offset auto needs the sonar's own turn rates", navigate, scans, tmp_path / "log.csv", settings)


def test_numbered_scans_and_clocks_from_zero_are_named() -> None:
    counted, dated = np.arange(5.0), START + np.arange(5.0)
    assert "the scans are numbered" in why_apart(dated, counted)
    assert "does not count from 1970" in why_apart(counted, dated)


def test_offsets_beyond_the_limit_are_refused() -> None:
    rng = np.random.default_rng(8)
    times, rates = turning(rng)
    a, b = sampled(times, rates, 0.1, 0.005, rng), sampled(times, rates, 0.1, 0.005, rng)
    refuses("cannot be estimated", estimate_offset, a[0] - 90, a[1], *b)
    assert estimate_offset(a[0] - 90, a[1], *b, most=120).seconds == pytest.approx(90, abs=0.1)
