"""Navigation from recordings as priors: the values and covariances come back, in the order and frames of the REPs."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.instruments import sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings
from tests.samples.bags.messages import (
    FIX,
    IMU,
    ODOMETRY,
    POSE,
    PRESSURE,
    STAMP,
    TF,
    fix,
    imu,
    odometry,
    pose,
    pressure,
    transforms,
)
from tests.samples.bags.samples import DEPTH, HEADING, PITCH, R_WORLD_BASE, ROLL, VARIANCES, instruments
from tests.samples.bags.writers import WRITERS, write_mcap, write_ros1
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import SIGMAS, scans_at

SCANS = scans_at(STAMP + 1.0, STAMP + 2.5)


def priors(
    path: Path | str, settings: NavigationSettings = AS_IT_SAYS
) -> tuple[list[PosePrior], Georeference | None, list[str]]:
    notes: list[str] = []
    navigated = navigate(SCANS, Path(path), settings, notes=notes)
    return [scan.prior for scan in navigated.scans if scan.prior is not None], navigated.georeference, notes


@pytest.mark.parametrize("writer", ["ros1", "sqlite", "sqlite alone", "ros2 mcap", "mcap"])
def test_fixes_orientations_and_pressures_are_given_back(tmp_path: Path, writer: str) -> None:
    """Written in East-North-Up and forward-left-up: with a heading from North, a pitch nose up, and a depth."""
    found, here, notes = priors(WRITERS[writer](tmp_path, instruments()))
    assert here is not None
    assert (here.latitude, here.longitude) == (60.39131, 5.32212)
    for prior, rows in zip(found, (4, 10), strict=True):
        # 2 micro degrees from the rounded origin, and 1 for each row, of 0.1114 m each
        expected = [ROLL, PITCH, HEADING, 0.0, 0.1114 * (2 + rows), DEPTH]
        np.testing.assert_allclose(values_of(prior.T_world_sensor), expected, atol=5e-3)
        np.testing.assert_allclose(sigmas_of(prior), [0.5, 0.75, 3.0, 0.5, 1.5, 0.125], rtol=1e-6)
    assert any("in salt water of 1,025 kg/m3; in fresh water they are 2.5 % larger" in note for note in notes)
    assert any("give --magnetic-declination DEG" in note for note in notes)


def test_sensors_are_moved_to_base_link(tmp_path: Path) -> None:
    """An IMU that looks to port and upside down, an antenna and a pressure sensor on lever arms."""
    turn, arm = Rotation.from_euler("ZYX", [90, 0, 180], degrees=True), np.array([-1.5, 0.75, 2.0])
    links = [
        (0.0, "base_link", "imu_link", (0.5, 0, 0), tuple(turn.as_quat())),
        (0.0, "base_link", "gps_link", tuple(arm), (0, 0, 0, 1)),
        (0.0, "base_link", "pressure_link", (3.0, 0, -0.5), (0, 0, 0, 1)),
    ]
    below = -R_WORLD_BASE.apply([3.0, 0, -0.5])[2]
    records = [
        ("/tf_static", TF, STAMP - 1.0, transforms(*links)),
        *instruments("{}_link", R_WORLD_BASE * turn, DEPTH + below),
    ]
    prior = priors(write_mcap(tmp_path / "a.mcap", records))[0][0]
    east, north, _ = R_WORLD_BASE.apply(arm)
    expected = [ROLL, PITCH, HEADING, -east, 0.1114 * 6 - north, DEPTH]
    np.testing.assert_allclose(values_of(prior.T_world_sensor), expected, atol=5e-3)
    np.testing.assert_allclose(sigmas_of(prior)[:3], [0.75, 0.5, 3.0], rtol=1e-6)  # turned by 90 degrees


def test_lever_arms_without_an_attitude_add_to_the_errors(tmp_path: Path) -> None:
    links = transforms(
        *((0.0, "base_link", f"{name}_link", (3.0, 4.0, 0.25), (0, 0, 0, 1)) for name in ("gps", "pressure"))
    )
    records = [record for record in instruments("{}_link") if record[1] != IMU]
    prior = priors(write_mcap(tmp_path / "a.mcap", [("/tf_static", TF, STAMP - 1.0, links), *records]))[0][0]
    assert values_of(prior.T_world_sensor)[5] == pytest.approx(DEPTH + 0.25)
    np.testing.assert_allclose(sigmas_of(prior)[3:], np.hypot([0.5, 1.5, 0.125], [5, 5, 1]), rtol=1e-6)


@pytest.mark.parametrize(("kind", "topic"), [(POSE, ""), (POSE, "::/pose"), (ODOMETRY, "::/pose")])
def test_poses_have_covariances_of_place_then_rotation(tmp_path: Path, kind: str, topic: str) -> None:
    sigmas = np.array([0.5, 1.5, 0.125, *np.radians([0.5, 0.75, 3.0])])
    turn = R_WORLD_BASE.as_quat().tolist()
    records = []
    for k in range(17):
        message = pose(STAMP + k / 4, (10 + k, -20, -DEPTH), turn, np.diag(sigmas**2))
        records.append(
            ("/pose", kind, STAMP + k / 4, message | ({"child_frame_id": "base_link"} if kind == ODOMETRY else {}))
        )
    path = write_mcap(tmp_path / "a.mcap", records)
    found, here, _ = priors(f"{path}{topic}")
    assert here is None
    for prior, east in zip(found, (14, 20), strict=True):
        np.testing.assert_allclose(values_of(prior.T_world_sensor), [ROLL, PITCH, HEADING, east, -20, DEPTH], atol=1e-6)
        np.testing.assert_allclose(sigmas_of(prior), [0.5, 0.75, 3.0, 0.5, 1.5, 0.125], rtol=1e-6)
    reckoned = read_odometry(Path(f"{path}{topic}"), SCANS, 0.01, 0.001).T_odom_sensor
    np.testing.assert_allclose(reckoned.translation, [[14, -20, -DEPTH], [20, -20, -DEPTH]], atol=1e-9)


@pytest.mark.parametrize("named", [True, False])
def test_north_east_down_is_told_by_the_frame_or_the_option(tmp_path: Path, named: bool) -> None:
    turn = Rotation.from_euler("ZYX", [HEADING, PITCH, ROLL], degrees=True)
    records = instruments("{}_ned" if named else "{}_link", turn)
    settings = AS_IT_SAYS if named else NavigationSettings(frame="ned", declination=2.0)
    prior = priors(write_mcap(tmp_path / "a.mcap", records), settings)[0][0]
    expected = [ROLL, PITCH, HEADING + (0 if named else 2)]
    np.testing.assert_allclose(values_of(prior.T_world_sensor)[:3], expected, atol=1e-6)


@pytest.mark.parametrize("frame", ["imu_link", "sonar_frame"])
def test_an_imu_in_north_east_down_is_told_by_gravity(tmp_path: Path, frame: str) -> None:
    """Forward, right, down in North-East-Down, under a name that does not say so."""
    turn = Rotation.from_euler("ZYX", [HEADING, PITCH, ROLL], degrees=True)
    force = turn.inv().apply([0, 0, -9.8]).tolist()
    times = (STAMP + np.arange(5.0)).tolist()
    records = [("/imu", IMU, t, imu(t, turn.as_quat().tolist(), VARIANCES, force, frame)) for t in times]
    found, _, notes = priors(write_mcap(tmp_path / "a.mcap", records))
    np.testing.assert_allclose(values_of(found[0].T_world_sensor)[:3], [ROLL, PITCH, HEADING], atol=1e-6)
    np.testing.assert_allclose(sigmas_of(found[0])[:3], [0.5, 0.75, 3.0], rtol=1e-6)
    assert any("the world of /imu is North-East-Down, as its accelerations show" in note for note in notes)


def test_gravity_gives_roll_and_pitch_without_an_orientation(tmp_path: Path) -> None:
    """An IMU on its side, which says by a covariance of -1 that it has no orientation."""
    turn = Rotation.from_euler("X", 90, degrees=True)
    force = (R_WORLD_BASE * turn).inv().apply([0, 0, 9.81]).tolist()
    times = STAMP + np.arange(0, 4, 0.02)
    links = transforms((0.0, "base_link", "imu_link", (0, 0, 0), tuple(turn.as_quat())))
    records = [("/imu", IMU, t, imu(t, (0, 0, 0, 1), (-1, 0, 0), force, "imu_link")) for t in times.tolist()]
    found, _, notes = priors(write_mcap(tmp_path / "a.mcap", [("/tf_static", TF, STAMP - 1.0, links), *records]))
    for prior in found:
        np.testing.assert_allclose(values_of(prior.T_world_sensor)[:2], [ROLL, PITCH], atol=0.01)
        assert 1.4 < sigmas_of(prior)[0] < 2.5
        assert not prior.knows_heading
    assert any("/imu has no orientation: roll and pitch are those of its accelerations" in note for note in notes)


def test_messages_without_a_measurement_are_left_out_and_counted(tmp_path: Path) -> None:
    records = instruments()
    records[0] = ("/fix", FIX, STAMP, fix(STAMP, 0.0, 0.0, (1, 1, 1)))
    records[2] = ("/pressure", PRESSURE, STAMP, pressure(STAMP, float("nan")))
    _, _, notes = priors(write_mcap(tmp_path / "a.mcap", records))
    assert any("1 of 17 messages of /fix are left out: without a fix" in note for note in notes)
    assert any("1 of 17 messages of /pressure are left out: not between 60,000 and" in note for note in notes)


def test_what_is_not_measured_has_a_huge_or_no_covariance(tmp_path: Path) -> None:
    """Drivers write 99999 for a heading without a compass, and 0 where they know nothing."""
    turn = R_WORLD_BASE.as_quat().tolist()
    records = [("/imu", IMU, t, imu(t, turn, (1e-4, 1e-4, 99999))) for t in (STAMP + np.arange(5.0)).tolist()]
    assert not priors(write_mcap(tmp_path / "a.mcap", records))[0][0].knows_heading
    records = [("/imu", IMU, t, imu(t, turn, (1e-4, 99999, 1e-4))) for t in (STAMP + np.arange(5.0)).tolist()]
    prior = priors(write_mcap(tmp_path / "c.mcap", records))[0][0]
    assert (prior.knows_attitude, prior.knows_heading) == (False, True)
    bare = write_mcap(tmp_path / "b.mcap", [("/imu", IMU, t, imu(t, turn)) for t in (STAMP + np.arange(5.0)).tolist()])
    refuses(r"b\.mcap: roll_deg has no covariance in some messages; give --prior-sigmas", priors, bare)
    prior = priors(bare, NavigationSettings(sigmas=SIGMAS))[0][0]
    np.testing.assert_allclose(sigmas_of(prior)[:3], 0.5)


def test_several_topics_of_a_kind_have_to_be_chosen(tmp_path: Path) -> None:
    more = [("/second", FIX, time, message) for topic, _, time, message in instruments() if topic == "/fix"]
    path = write_ros1(tmp_path / "a.bag", [*instruments(), *more])
    refuses(r"several of its topics measure the same: .*a\.bag::/", priors, path)
    prior = priors(f"{path}::/second")[0][0]
    assert prior.knows_position
    assert not prior.knows_attitude
    refuses("it has no topic /none; its topics are", priors, f"{path}::/none")
    alone = write_mcap(tmp_path / "b.mcap", [("/odom", ODOMETRY, 1.0, odometry(1.0, (0, 0, 0), (0, 0, 0, 1)))])
    refuses(r"dead reckoning alone, which drifts: use --odometry .*b\.mcap", priors, alone)
    gauge = write_mcap(tmp_path / "c.mcap", [("/p", PRESSURE, 1.0, pressure(1.0, 4_000.0))])
    refuses("all 1 messages of /p are not between .* wanted absolute pressures in pascal", priors, gauge)
