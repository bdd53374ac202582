"""Dead reckoning from TUM and CSV files and recordings, at the scans' times."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.navigation.odometry import parse_drift, read_odometry
from sonarmap.tools.files.writers.poses import write_tum
from tests.samples.bags.messages import ODOMETRY, TF, odometry, transforms
from tests.samples.bags.writers import WRITERS, Record, write_mcap, write_ros1
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import scans_at

TIMES = np.arange(0.0, 20.0, 0.5)
PATH = RigidTransform.from_components(
    np.column_stack([TIMES, 0.5 * TIMES, -TIMES / 10]), Rotation.from_euler("Z", 0.1 * TIMES[:, None])
)


def written(folder: Path, times: np.ndarray = TIMES, poses: RigidTransform = PATH) -> Path:
    write_tum(folder / "odometry.tum", Trajectory(times, poses))
    return folder / "odometry.tum"


def test_poses_are_interpolated_to_the_scans(tmp_path: Path) -> None:
    odometry = read_odometry(written(tmp_path), scans_at(1.25, 7.0, 19.4), 0.02, 0.001)
    np.testing.assert_array_equal(odometry.scans, [0, 1, 2])
    np.testing.assert_allclose(odometry.T_odom_sensor.translation[:, 0], [1.25, 7.0, 19.4], atol=1e-9)
    turns = odometry.T_odom_sensor.rotation.as_euler("ZYX")[:, 0]
    np.testing.assert_allclose(turns, [0.125, 0.7, 1.94], atol=1e-9)
    assert (odometry.drift, odometry.turn_drift) == (0.02, 0.001)


def test_scans_outside_of_its_time_and_in_gaps_are_noted(tmp_path: Path) -> None:
    keep = (TIMES < 5) | (TIMES > 15)
    path = written(tmp_path, TIMES[keep], PATH[keep])
    notes: list[str] = []
    odometry = read_odometry(path, scans_at(1.0, 2.2, 10.0, 16.0, 30.0), 0.01, 0.0, notes)
    np.testing.assert_array_equal(odometry.scans, [0, 1, 3])
    assert notes == [f"{path} does not cover 2 of 5 scans: scan2 ..."]


def test_csv_has_the_columns_of_a_priors_file(tmp_path: Path) -> None:
    path = tmp_path / "odometry.csv"
    path.write_text("stamp;roll_deg;pitch_deg;heading_deg;x_m;y_m;depth_m\n0;0;0;90;0;0;1\n10;0;0;80;5,5;1;2\n")
    odometry = read_odometry(path, scans_at(0.0, 10.0), 0.01, 0.0)
    T = odometry.T_odom_sensor[0].inv() * odometry.T_odom_sensor[1]
    np.testing.assert_allclose(T.translation, [5.5, 1.0, -1.0], atol=1e-9)
    assert np.degrees(T.rotation.as_rotvec()[2]) == pytest.approx(10.0)


HEADING = "stamp,roll_deg,pitch_deg,heading_deg,x_m,y_m,depth_m\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("stamp,x_m,y_m\n0,1,1\n", "roll_deg, pitch_deg, heading_deg, depth_m not found"),
        (HEADING + "0,0,0,,1,1,1\n1,0,0,5,1,1,1\n", "line 2: heading_deg is empty"),
        (HEADING, "no row below its heading"),
    ],
)
def test_csv_that_cannot_be_used_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "odometry.csv"
    path.write_text(text)
    refuses(rf"odometry\.csv.*{words}", read_odometry, path, scans_at(0.0, 1.0), 0.01, 0.0)


def test_other_clocks_and_unordered_stamps_are_refused(tmp_path: Path) -> None:
    words = r"covers 0 of the 2 scans: the rows run from 0\.000 s to 19\.500 s"
    refuses(words, read_odometry, written(tmp_path), scans_at(1000.0, 1001.0), 0.01, 0.0)
    path = written(tmp_path, np.concatenate([TIMES[:3], TIMES[2:]]), PATH[[0, 1, 2, *range(2, 40)]])
    refuses("ascending stamps; pose 3 is out of order", read_odometry, path, scans_at(0.0, 1.0), 0.01, 0.0)


def test_drift_is_percent_and_degrees_per_hour() -> None:
    assert parse_drift("1,10") == pytest.approx((0.01, np.radians(10) / 3600))
    for text in ("1", "1,x", "-1,5", "0,0", "1,2,3", "1e308,1", "0,1e-200", "inf,1"):
        refuses("as in --odometry-drift 1,10", parse_drift, text)


TURN = Rotation.from_euler("ZYX", [30, -10, 5], degrees=True)
ALONE, LEFT = (0, 0, 0, 1), (0, 0, np.sqrt(0.5), np.sqrt(0.5))


def poses_of(path: Path, *stamps: float) -> RigidTransform:
    return read_odometry(path, scans_at(*stamps), 0.01, 0.001).T_odom_sensor


def driven(topic: str = "/odom", **frames: str) -> list[Record]:
    """2 m a second along x and -0.5 m along y, with one attitude; the second pose comes last and twice."""
    times = [100.0, 102.0, 103.0, 101.0, 101.0]
    turn = TURN.as_quat().tolist()
    poses = [odometry(t, (2 * (t - 100), -0.5 * (t - 100), 7), turn, **frames) for t in times]
    return [(topic, ODOMETRY, 110.0 + k, pose) for k, pose in enumerate(poses)]


@pytest.mark.parametrize("writer", ["ros1", "mcap", "sqlite"])
def test_messages_are_interpolated_to_the_scans(tmp_path: Path, writer: str) -> None:
    poses = poses_of(WRITERS[writer](tmp_path, driven()), 100.0, 101.5, 103.0)
    np.testing.assert_allclose(poses.translation, [[0, 0, 7], [3, -0.75, 7], [6, -1.5, 7]], atol=1e-9)
    np.testing.assert_allclose(poses.rotation.as_matrix(), np.tile(TURN.as_matrix(), (3, 1, 1)), atol=1e-9)


def test_odometry_of_a_mounted_sensor_is_moved_to_base_link(tmp_path: Path) -> None:
    """Odometry of a DVL that looks to port, 1 m ahead and 2 m to port of base_link."""
    static = ("/tf_static", TF, 99.0, transforms((0.0, "base_link", "dvl_link", (1, 2, 0.5), LEFT)))
    path = write_mcap(tmp_path / "a.mcap", [static, *driven(child="dvl_link")])
    T_odom_dvl = RigidTransform.from_components([0, 0, 7], TURN)
    T_base_dvl = RigidTransform.from_components([1, 2, 0.5], Rotation.from_euler("Z", 90, degrees=True))
    expected = T_odom_dvl * T_base_dvl.inv()
    np.testing.assert_allclose(poses_of(path, 100.0, 101.0)[0].as_matrix(), expected.as_matrix(), atol=1e-9)


def test_frames_that_point_down_are_converted(tmp_path: Path) -> None:
    """North-East-down to East-North-up, forward-right-down to forward-left-up: a heading of 30 is a yaw of 60."""
    turn = Rotation.from_euler("ZYX", [30, 10, -5], degrees=True).as_quat().tolist()
    records = [
        ("/odom", ODOMETRY, 1.0 + t, odometry(t, (1, 2, 3 + t), turn, "odom_ned", "base_link_frd")) for t in (5.0, 6.0)
    ]
    pose = poses_of(write_mcap(tmp_path / "a.mcap", records), 5.0, 6.0)[0]
    np.testing.assert_allclose(pose.translation, [2, 1, -8], atol=1e-9)
    np.testing.assert_allclose(pose.rotation.as_euler("ZYX", degrees=True), [60, -10, -5], atol=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("turn", [0.0, 1e308])
def test_invalid_poses_are_left_out_and_refused_if_there_is_no_other(tmp_path: Path, turn: float) -> None:
    records = driven()
    records[2][3]["pose"]["pose"]["orientation"] = dict.fromkeys("xyzw", turn)
    notes: list[str] = []
    path = write_ros1(tmp_path / "a.bag", records)
    reckoned = read_odometry(path, scans_at(100.0, 101.0, 103.0), 0.01, 0.001, notes)
    np.testing.assert_array_equal(reckoned.scans, [0, 1])
    assert notes[0] == f"{path}: 1 of 4 messages of /odom are left out: without a unit quaternion"
    for record in records:
        record[3]["pose"]["pose"]["orientation"] = dict.fromkeys("xyzw", turn)
    words = r"b\.bag: all 4 messages of /odom are without a unit quaternion"
    refuses(words, poses_of, write_ros1(tmp_path / "b.bag", records), 100.0, 101.0)


def test_one_of_several_topics_has_to_be_named(tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", driven("/odom") + driven("/dvl/odom"))
    refuses(r"it has 2 topics of nav_msgs/msg/Odometry: .*a\.bag::/dvl/odom", poses_of, path, 100.0, 101.0)
    assert len(poses_of(Path(f"{path}::/odom"), 100.0, 101.0)) == 2
