"""Frames of recordings: mounting by tf_static, optical frames by their names; worked by hand."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.tools.command.overview import overview_of
from sonarmap.tools.files.readers.scans import Corrections, PointFrame, read_scan, read_scans
from tests.samples.bags.messages import CLOUD, IMU, TF, cloud, imu, transforms
from tests.samples.bags.writers import WRITERS, Record, write_mcap
from tests.samples.cloud_files import POINTS, STRENGTH
from tests.samples.refusals import refuses

HALF = np.sqrt(0.5)
LEFT = (0, 0, HALF, HALF)  # a quarter turn about z
ALONE = (0, 0, 0, 1)


def mounted(*links: tuple, frame: str = "sonar_link") -> list[Record]:
    return [
        ("/tf_static", TF, 1.0, transforms(*[(0.0, *link) for link in links])),
        ("/points", CLOUD, 2.0, cloud(frame=frame)),
    ]


@pytest.mark.parametrize("writer", ["ros1", "mcap", "sqlite"])
def test_points_are_in_base_link_and_seen_from_the_sensors_place(tmp_path: Path, writer: str) -> None:
    """A sonar a quarter turn to port, 3 m ahead, 0.5 m to starboard and 0.25 m below."""
    path = WRITERS[writer](tmp_path, mounted(("base_link", "sonar_link", (3, -0.5, -0.25), LEFT)))
    read = read_scans([path])
    x, y, z = POINTS.T
    np.testing.assert_allclose(read.scans[0].points, np.column_stack([3 - y, -0.5 + x, -0.25 + z]), atol=1e-6)
    np.testing.assert_allclose(np.asarray(read.scans[0].viewpoints), np.tile([3, -0.5, -0.25], (5, 1)), atol=1e-6)
    np.testing.assert_array_equal(read.scans[0].strength, STRENGTH)
    assert read.notes == (
        f"{path.name}: points are in base_link, by tf_static: sonar_link is there at 3.000, -0.500, -0.250 m, with "
        "roll 0.00, pitch 0.00, yaw 90.00 degrees",
    )


def test_transforms_are_chained_up_and_down(tmp_path: Path) -> None:
    """From the sonar up to the mast, and down to base_link, which is the mast's child."""
    links = [("mast", "rov/base_link", (0, 0, -2), LEFT), ("mast", "sonar_link", (1, 0, 0), ALONE)]
    scan = read_scan(write_mcap(tmp_path / "a.mcap", mounted(*links)))
    x, y, z = POINTS.T
    # in the mast (x + 1, y, z); base_link is 2 m lower and looks to the mast's left: turned back to the right
    np.testing.assert_allclose(scan.points, np.column_stack([y, -(x + 1), z + 2]), atol=1e-6)
    np.testing.assert_allclose(np.asarray(scan.viewpoints), np.tile([0, -1, 2], (5, 1)), atol=1e-6)


@pytest.mark.parametrize(
    ("frame", "axes", "signs"),
    [
        ("camera_optical_frame", [2, 0, 1], [1, -1, -1]),  # x right, y down, z forward
        ("sonar_optical", [2, 0, 1], [1, -1, -1]),
        ("sonar_frd", [0, 1, 2], [1, -1, -1]),
    ],
)
def test_optical_and_frd_frames_are_turned(tmp_path: Path, frame: str, axes: list[int], signs: list[int]) -> None:
    read = read_scans([write_mcap(tmp_path / "a.mcap", [("/points", CLOUD, 1.0, cloud(frame=frame))])])
    np.testing.assert_allclose(read.scans[0].points, POINTS[:, axes] * signs, atol=1e-6)
    assert read.notes[0].startswith(f"a.mcap: points in {frame} are turned to x forward, y left, z up, as its name _")


DOWN = POINTS * [1, -1, -1]


@pytest.mark.parametrize(
    ("frame", "topic"), [("sonar_frame", "/points"), ("rov/sonar_frame", "/p"), ("sonar", "/rov/sonar_point_cloud")]
)
@pytest.mark.parametrize("writer", ["ros1", "mcap", "sqlite"])
def test_the_axes_of_the_makers_driver_are_asked_for(tmp_path: Path, writer: str, frame: str, topic: str) -> None:
    path = WRITERS[writer](tmp_path, [(topic, CLOUD, 1.0, cloud(frame=frame))])
    refuses(f"points in {frame} may be x forward, y right, z down, .* `frame=frd` or `frame=flu`", read_scans, [path])
    notes = [note for note in overview_of([path]).notes if "say which" in note]
    assert len(notes) == 1
    for axes, points in (("flu", POINTS), ("frd", DOWN)):
        read = read_scans([path], Corrections(frame=PointFrame(axes)))
        np.testing.assert_allclose(read.scans[0].points, points, atol=1e-6)


@pytest.mark.parametrize(("z", "points", "side"), [(9.7, POINTS, "up"), (-9.7, DOWN, "down"), (4.0, None, "")])
def test_gravity_shows_the_axes_of_the_makers_driver(tmp_path: Path, z: float, points: np.ndarray, side: str) -> None:
    """With roll and pitch of a vehicle; on its side the sonar shows nothing, and neither does an IMU elsewhere."""
    force = (1.0, np.sqrt(9.80665**2 - z**2 - 1.0), z)
    records = [("/imu", IMU, 1.0 + k, imu(1.0 + k, force=force, frame="sonar_frame")) for k in range(3)]
    records += [("/other", IMU, 1.0, imu(1.0, force=(0, 0, 9.8), frame="imu_link"))]
    path = write_mcap(tmp_path / "a.mcap", [*records, ("/points", CLOUD, 1.0, cloud(frame="sonar_frame"))])
    if points is None:
        refuses("say which", read_scans, [path])
        return
    read = read_scans([path])
    np.testing.assert_allclose(read.scans[0].points, points, atol=1e-6)
    assert f"points in sonar_frame have z {side}, as the gravity shows" in read.notes[0]


@pytest.mark.parametrize("frame", ["sonar_frame", "sonar_frd"])
def test_the_axes_that_are_given_are_the_sensors_own(tmp_path: Path, frame: str) -> None:
    """They are used before the mounting, once, and in place of those that a name tells."""
    link = ("base_link", frame, (1, 2, 3), ALONE if frame == "sonar_frame" else (1, 0, 0, 0))
    given = Corrections(frame=PointFrame("frd"))
    mounted_at = write_mcap(tmp_path / "a.mcap", mounted(link, frame=frame))
    np.testing.assert_allclose(read_scans([mounted_at], given).scans[0].points, DOWN + np.arange(1, 4), atol=1e-6)
    if frame == "sonar_frd":
        np.testing.assert_allclose(read_scans([mounted_at]).scans[0].points, DOWN + np.arange(1, 4), atol=1e-6)
        alone = write_mcap(tmp_path / "b.mcap", mounted(frame=frame))
        np.testing.assert_allclose(read_scans([alone], given).scans[0].points, DOWN, atol=1e-6)
        up = Corrections(frame=PointFrame("flu"))
        np.testing.assert_allclose(read_scans([alone], up).scans[0].points, POINTS, atol=1e-6)


def test_tf_is_preferred_to_the_name(tmp_path: Path) -> None:
    turn = Rotation.from_euler("ZYX", [20, -10, 5], degrees=True)
    link = ("base_link", "sonar_optical", (1, 2, 3), tuple(turn.as_quat()))
    scan = read_scan(write_mcap(tmp_path / "a.mcap", mounted(link, frame="sonar_optical")))
    np.testing.assert_allclose(scan.points, turn.apply(POINTS.astype(float)) + np.arange(1, 4), atol=1e-5)


@pytest.mark.parametrize("frame", ["sonar_link", "base_link"])
def test_points_stay_without_a_transform_and_a_turn_alone_adds_no_viewpoints(tmp_path: Path, frame: str) -> None:
    links = [("mast", "sonar_link", (1, 2, 3), LEFT), ("base_link", "imu_link", (1, 2, 3), LEFT)]
    read = read_scans([write_mcap(tmp_path / "a.mcap", mounted(*links, frame=frame))])
    np.testing.assert_array_equal(read.scans[0].points, POINTS)
    assert read.notes == ()
    scan = read_scan(write_mcap(tmp_path / "b.mcap", mounted(("base_link", "sonar_link", (0, 0, 0), LEFT))))
    np.testing.assert_allclose(scan.points, POINTS[:, [1, 0, 2]] * [-1, 1, 1], atol=1e-6)
    assert scan.viewpoints is None


@pytest.mark.parametrize(("turn", "shown"), [((0, 0, 0, 0), "0 0 0 0"), ((np.nan, 0, 0, 1), "nan 0 0 1")])
def test_invalid_transforms_are_refused_unless_unused(tmp_path: Path, turn: tuple, shown: str) -> None:
    path = write_mcap(tmp_path / "a.mcap", mounted(("base_link", "sonar_link", (3, 0, 0), turn)))
    refuses(f"transform base_link to sonar_link .* is 3 0 0 {shown}; wanted meters and a", read_scan, path)
    bystander = ("base_link", "imu_link", (3, 0, 0), turn)
    assert read_scan(write_mcap(tmp_path / "b.mcap", mounted(bystander))).viewpoints is None
