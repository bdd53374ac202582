"""Tables as rostopic, EuRoC, MAVLink loggers and spreadsheets write them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.files.readers.instruments import poses_of, values_of
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.overview import is_log, read_navigation
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from sonarmap.tools.files.readers.trajectory import read_pair
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import SCANS, START, read, scans_at

TRUTH = RigidTransform.from_components(
    np.outer(np.arange(12.0), [1.5, 0.5, -0.25]),
    Rotation.from_euler("ZYX", [[20 + 3 * k, 5 - k, 2 * k] for k in range(12)], degrees=True),
)
STAMPS = START + np.arange(12.0)


def euroc(stamps: np.ndarray, T: RigidTransform) -> str:
    names = "p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v_RS_R_x [m s^-1]"
    rows = np.column_stack([T.translation, np.roll(T.rotation.as_quat(), 1, axis=1), np.zeros(len(stamps))])
    lines = [f"{round(s * 1e9)},{','.join(f'{x:.9f}' for x in row)}" for s, row in zip(stamps, rows, strict=True)]
    return "\n".join([f"#timestamp [ns],{names}", *lines, ""])


def test_a_rostopic_table_has_time_and_depth(path: Path) -> None:
    """The time of the message, in ns, and not the one at which it was recorded."""
    text = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.depth\n" + "".join(
        f"{round((START + k + 0.4) * 1e9)},{k},{round((START + k) * 1e9)},pressure,{5 + 0.1 * k:.3f}\n"
        for k in range(30)
    )
    values, _, notes = read(path, text, scans=scans_at(START + 3, START + 6.5))
    np.testing.assert_allclose(values[:, 5], [5.3, 5.65], atol=1e-5)
    assert any("'%time', 'field.header.seq'" in note for note in notes)
    assert is_log(path)


def test_a_rostopic_table_of_odometry_is_dead_reckoning(path: Path) -> None:
    names = ["position.x", "position.y", "position.z", *(f"orientation.{x}" for x in "xyzw")]
    rows = np.column_stack([TRUTH.translation, TRUTH.rotation.as_quat()])
    lines = [f"{round(s * 1e9)},{','.join(map(str, row))}" for s, row in zip(STAMPS, rows.tolist(), strict=True)]
    path.write_text("\n".join([",".join(["%time", *(f"field.pose.pose.{name}" for name in names)]), *lines, ""]))
    found = read_odometry(path, scans_at(*STAMPS[2:5]), 0.01, 0.001)
    np.testing.assert_allclose(found.T_odom_sensor.as_matrix(), TRUTH[2:5].as_matrix(), atol=1e-6)


def test_a_euroc_table_is_a_trajectory_with_w_first(path: Path) -> None:
    path.write_text(euroc(STAMPS, TRUTH))
    assert is_log(path)
    found = read_odometry(path, scans_at(*STAMPS[2:5]), 0.01, 0.001)
    np.testing.assert_allclose(found.T_odom_sensor.as_matrix(), TRUTH[2:5].as_matrix(), atol=1e-6)
    values, *_ = read(path, euroc(STAMPS, TRUTH), scans=scans_at(*STAMPS[2:5]))
    np.testing.assert_allclose(values, values_of(TRUTH[2:5]), atol=1e-5)
    estimate, truth = read_pair(path, path)
    np.testing.assert_allclose(estimate.T_world_sensor.as_matrix(), TRUTH.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(truth.stamps, STAMPS, atol=1e-5)


def test_quaternions_in_north_east_down(path: Path) -> None:
    R = Rotation.from_euler("ZYX", [[30, 5, -3]] * 3, degrees=True).as_quat()  # heading, pitch, roll
    rows = [f"{START + 5 * k},1,2,3,{','.join(map(str, q))}" for k, q in enumerate(R.tolist())]
    text = "\n".join(["time,x,y,z,qx,qy,qz,qw", *rows, ""])
    values, *_ = read(path, text, NavigationSettings(frame="ned"))
    np.testing.assert_allclose(values, [[-3, 5, 30, 2, 1, 3]] * 3, atol=1e-6)


def test_a_second_line_of_units_counts(path: Path) -> None:
    rows = "".join(f"{START + 5 * k},{1000 + k},0.5,0.1,x\n" for k in range(3))
    for units in ("s,mm,rad,rad,", "[s],[mm],[rad],[rad],[-]", "(s),(mm),(rad),(rad),counts"):
        values, *_ = read(path, f"Time,Depth,Roll,Pitch,Note\n{units}\n{rows}")
        np.testing.assert_allclose(values[:, 5], [1.0, 1.001, 1.002], atol=1e-6)
        np.testing.assert_allclose(values[:, :2], np.degrees([[0.5, 0.1]] * 3), atol=1e-6)


def test_times_of_a_spreadsheet_are_days(path: Path) -> None:
    rows = "".join(f"{25569 + (START + k) / 86400:.10f},{5 + k}\n" for k in range(12))
    values, _, notes = read(path, "Time,Depth\n" + rows)
    np.testing.assert_allclose(values[:, 5], [5, 10, 15], atol=1e-3)
    assert any("days since 1899-12-30" in note for note in notes)
    seconds = "".join(f"{40000 + 0.5 * k},{5 + k}\n" for k in range(12))  # of a clock with a start of its own
    values, *_ = read(path, "Time,Depth\n" + seconds, scans=scans_at(40001.0, 40002.0))
    np.testing.assert_allclose(values[:, 5], [7, 9])


def mavlink(missing: str = "2147483647") -> str:
    rows = [
        f"{round((START + k) * 1e6)},{603913000 + 90 * k},{53221000},{65535 if k % 7 == 3 else 9000 + 10 * k},{k}"
        for k in range(40)
    ]
    rows[5] = f"{round((START + 5) * 1e6)},{missing},{missing},9050,5"
    return "\n".join(["time_usec,lat,lon,hdg,alt", *rows, ""]).replace("time_usec", "time (us)")


def test_whole_numbers_of_mavlink_are_read(path: Path) -> None:
    values, navigated, notes = read(path, mavlink(), scans=scans_at(START, START + 9))
    assert navigated.georeference is not None
    assert navigated.georeference.latitude == pytest.approx(60.3913, abs=1e-5)
    np.testing.assert_allclose(values[:, 2], [90, 90.9], atol=1e-6)
    assert values[1, 4] - values[0, 4] == pytest.approx(9 * 90e-7 * 111_415, rel=0.01)
    said = "\n".join(notes)
    assert "lat is taken as whole numbers of 1e-07 degrees" in said
    assert "hdg is taken as whole numbers of 0.01 degrees" in said
    assert "6 headings are left out" in said
    assert ": 65535, which no instrument measures" in said
    assert ": 2147483647, which no instrument measures" in said


def test_whole_numbers_of_depth_are_asked_about(path: Path) -> None:
    rows = "".join(f"{START + k},{12000 + k}\n" for k in range(12))
    refuses(
        r"depth has whole numbers, 12006 in the median; name the unit.*depth \(mm\)", read, path, "time,depth\n" + rows
    )
    values, *_ = read(path, "time,depth (mm)\n" + rows)
    np.testing.assert_allclose(values[:, 5], [12, 12.005, 12.01])


@pytest.mark.parametrize("offset", [3.0, 5.0])
def test_positions_that_alternate_between_two_receivers_are_refused(path: Path, offset: float) -> None:
    rows = [f"{START + k},{1.2 * k + offset * (k % 2):.2f},{0.3 * k:.2f}" for k in range(40)]
    text = "\n".join(["time,x,y", *rows, ""])
    refuses(f"alternate between two places {offset:.1f} m apart.*lines 3, 5, 7", read, path, text)


def test_a_column_of_zeros_is_no_attitude(path: Path) -> None:
    rows = "".join(f"{START + k},0,0,0,{5 + k / 10}\n" for k in range(20))
    values, _, notes = read(path, "time,roll,pitch,heading,depth\n" + rows)
    assert np.isnan(values[:, :3]).all()
    assert np.isfinite(values[:, 5]).all()
    assert any("0 in all rows" in note for note in notes)


def test_a_heading_line_behind_a_number_sign_needs_numbers_below(path: Path) -> None:
    path.write_text("# time, depth\ntime,depth\n1,2\n")
    log = read_navigation(path, NavigationSettings(), None, np.zeros(0), [])
    assert log.values[:, 5].tolist() == [2]
    assert poses_of(np.nan_to_num(log.values)).translation[0, 2] == -2
    assert SCANS
