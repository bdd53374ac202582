"""Dead reckoning from TUM and CSV files, at the scans' times."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.navigation.odometry import parse_drift, read_odometry
from sonarmap.tools.files.writers.trajectory import write_tum
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


def test_scans_outside_of_its_time_and_in_gaps_are_told(tmp_path: Path) -> None:
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
    with pytest.raises(InputError, match=r"odometry\.csv") as error:
        read_odometry(path, scans_at(0.0, 1.0), 0.01, 0.0)
    assert words in str(error.value)


def test_other_clocks_and_orders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"covers 0 of the 2 scans: the rows run from 0\.000 s to 19\.500 s"):
        read_odometry(written(tmp_path), scans_at(1000.0, 1001.0), 0.01, 0.0)
    back = np.concatenate([TIMES[:3], TIMES[2:]])
    with pytest.raises(InputError, match="ascend; pose 3 does not"):
        read_odometry(written(tmp_path, back, PATH[[0, 1, 2, *range(2, 40)]]), scans_at(0.0, 1.0), 0.01, 0.0)


def test_drift_is_percent_and_degrees_per_hour() -> None:
    assert parse_drift("1,10") == pytest.approx((0.01, np.radians(10) / 3600))
    for text in ("1", "1,x", "-1,5", "0,0", "1,2,3", "1e308,1", "0,1e-200", "inf,1"):
        with pytest.raises(InputError, match="as in --odometry-drift 1,10"):
            parse_drift(text)
