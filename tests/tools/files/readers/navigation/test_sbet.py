"""SBET files with SMRMSG; the two records of a real one tell the sign of the wander angle."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.instruments import sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.overview import is_log, read_navigation
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from sonarmap.tools.files.time_scales import gps_of_utc
from tests.samples.places import DATA
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import SIGMAS, START, scans_at

WEEK = 604_800.0
FIRST = float(gps_of_utc(np.array([START]))[0]) % WEEK  # seconds of the week


def sbet(count: int = 101, every: float = 0.1, first: float = FIRST) -> np.ndarray:
    """(n, 17) a vehicle that moves North by 2e-7 rad a second and sinks, with a heading of 40 to 50 degrees."""
    k = every * np.arange(count)
    rows = np.zeros((count, 17))
    rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = first + k, 1.05 + 2e-7 * k, 0.09, -10 - 0.1 * k
    rows[:, 7:11] = np.column_stack([*np.radians([2 + 0 * k, -1 + 0 * k, 30 + k, -10 + 0 * k])])
    return rows


def smrmsg(first: float = FIRST - 5) -> np.ndarray:
    """(n, 10) standard deviations each second: North 0.1, East 0.2, down 0.3 m; 0.6, 1.2 and 3 minutes of arc."""
    return np.column_stack([first + np.arange(30.0), np.tile([0.1, 0.2, 0.3, 0, 0, 0, 0.6, 1.2, 3.0], (30, 1))])


def test_poses_and_standard_deviations_are_read(tmp_path: Path) -> None:
    path = tmp_path / "sbet_M1.out"
    sbet().tofile(path)
    smrmsg().tofile(tmp_path / "smrmsg_M1.out")
    assert is_log(path)
    notes = list[str]()
    scans = navigate(scans_at(START + 2, START + 5.05), path, NavigationSettings(), notes=notes).scans
    priors = [scan.prior for scan in scans if scan.prior is not None]
    values = np.array([values_of(prior.T_world_sensor) for prior in priors])
    np.testing.assert_allclose(values[:, :3], [[2, -1, 42], [2, -1, 45.05]], atol=1e-4)
    np.testing.assert_allclose(values[:, 5], [10.2, 10.505], atol=1e-3)
    assert values[1, 4] - values[0, 4] == pytest.approx(3.05 * 2e-7 * 6_383_500, rel=2e-3)
    np.testing.assert_allclose(sigmas_of(priors[0]), [0.01, 0.02, 0.05, 0.2, 0.1, 0.3], rtol=1e-6)
    said = "\n".join(notes)
    assert "GPS week 2425, as that of the scans" in said
    assert "above the ellipsoid" in said
    odometry = read_odometry(path, scans_at(START + 2, START + 5), 0.01, 0.001)
    assert np.linalg.norm(np.diff(odometry.T_odom_sensor.translation, axis=0)) == pytest.approx(3.84, abs=0.02)


def test_the_week_is_that_of_the_scans_or_the_users(tmp_path: Path) -> None:
    path = tmp_path / "sbet.out"
    sbet().tofile(path)
    start = START - FIRST  # of the week in UTC
    given = NavigationSettings(offset=start, sigmas=SIGMAS)
    scans = navigate(scans_at(START + 2), path, given).scans
    assert scans[0].prior is not None
    as_utc = NavigationSettings(time_scale="utc", sigmas=SIGMAS)
    scans = navigate(scans_at(START + 2 + 18), path, as_utc).scans
    assert scans[0].prior is not None
    assert values_of(scans[0].prior.T_world_sensor)[5] == pytest.approx(10.2, abs=1e-3)
    refuses("the scans have no dates.*--nav-offset", navigate, scans_at(1, 2), path, NavigationSettings(sigmas=SIGMAS))
    refuses("no SMRMSG file beside it", navigate, scans_at(START + 2), path, NavigationSettings())


def test_damaged_records_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "cut.sbet"
    rows = sbet()
    rows[7, 1] = np.nan
    rows[9, 2] = 1e300
    path.write_bytes(rows.tobytes()[:-50])
    notes = list[str]()
    log = read_navigation(path, NavigationSettings(), None, np.array([START]), notes)
    assert len(log.times) == 98
    assert any("last 86 bytes" in note for note in notes)
    assert any("2 of 100 records" in note for note in notes)
    (tmp_path / "cut.smrmsg").write_bytes(smrmsg(FIRST + 900).tobytes())
    refuses("not the SMRMSG file of cut.sbet", read_navigation, path, NavigationSettings(), None, np.array([START]), [])


def test_the_sign_of_the_wander_angle_is_that_of_a_real_file() -> None:
    path = DATA / "real" / "navigation" / "2-points.sbet"
    if not path.is_file():
        pytest.skip("shared/data/real/navigation is not beside the checkout")
    record, _ = np.fromfile(path).reshape(-1, 17)
    log = read_navigation(path, NavigationSettings(), None, np.zeros(0), [])
    east, north = np.diff(log.values[:, 3:5], axis=0)[0]
    # velocities are in the wander-azimuth frame, x North and y West of its axes
    course = np.degrees(np.arctan2(-record[5], record[4]) - record[10])
    assert np.degrees(np.arctan2(east, north)) % 360 == pytest.approx(course % 360, abs=0.5)
    assert log.values[0, 2] == pytest.approx(np.degrees(record[9] - record[10]), abs=1e-6)
