"""map.mcap, read by the mcap library's ROS 2 decoder and by rosbags, against the map."""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.instruments import values_of
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.mcap import write_mcap
from tests.tools.files.readers.navigation.logs import scans_at
from tests.tools.products.export.poses import dive, with_part

KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def messages(path: Path, earth: Georeferenced, on_earth: bool = True) -> dict[str, list[tuple[float, Any]]]:
    """Log times [s] and messages of each topic; the headers' stamps must equal the log times."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    write_mcap(path / "map.mcap", earth.folder, earth.part, earth if on_earth else None)
    topics: dict[str, list[tuple[float, Any]]] = defaultdict(list)
    with (path / "map.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for _, channel, message, decoded in reader.iter_decoded_messages():
            header = decoded.transforms[0].header if channel.topic.startswith("/tf") else decoded.header
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == message.log_time
            topics[channel.topic].append((message.log_time / 1e9, decoded))
    return topics


def table(cloud: Any) -> np.ndarray:
    """The records of a PointCloud2, by its fields."""
    layout = np.dtype([(field.name, KINDS[field.datatype]) for field in cloud.fields])
    assert cloud.point_step == layout.itemsize
    assert cloud.row_step == layout.itemsize * cloud.width
    ends = np.cumsum([layout[field.name].itemsize for field in cloud.fields])
    assert [field.offset for field in cloud.fields] == [0, *ends[:-1]]
    return np.frombuffer(bytes(cloud.data), layout)


def xyz(records: np.ndarray) -> np.ndarray:
    return np.column_stack([records[axis] for axis in "xyz"]).astype(np.float64)


def numbers(message: Any, names: str) -> list[float]:
    return [getattr(message, name) for name in names]


@pytest.fixture
def topics(tmp_path: Path) -> dict[str, list[tuple[float, Any]]]:
    """Log times [s] and messages of a dive, by topic."""
    return messages(tmp_path, dive())


def test_the_cloud_has_the_points_of_the_map(topics: dict[str, list[tuple[float, Any]]]) -> None:
    earth = dive()
    ((time, cloud),) = topics["/map/points"]
    assert (time, cloud.header.frame_id, cloud.height, cloud.width) == (1.7e9, "map", 1, 500)
    records = table(cloud)
    np.testing.assert_allclose(xyz(records), earth.part.points, rtol=0, atol=1e-4)
    for name, column in earth.part.columns.items():
        np.testing.assert_array_equal(records[name], column)


def test_poses_and_transforms_follow_the_trajectory(topics: dict[str, list[tuple[float, Any]]]) -> None:
    part = dive().part.trajectory
    ((_, path),) = topics["/track"]
    places = [numbers(pose.pose.position, "xyz") for pose in path.poses]
    np.testing.assert_allclose(places, part.T_world_sensor.translation)
    for k, ((at, pose), (when, tf)) in enumerate(zip(topics["/pose"], topics["/tf"], strict=True)):
        (transform,) = tf.transforms
        assert at == when == pytest.approx(1.7e9 + 2.5 * k, abs=1e-6)
        assert (transform.header.frame_id, transform.child_frame_id, pose.header.frame_id) == ("map", "sensor", "map")
        for place, turn in (
            (pose.pose.pose.position, pose.pose.pose.orientation),
            (transform.transform.translation, transform.transform.rotation),
        ):
            np.testing.assert_allclose(numbers(place, "xyz"), part.T_world_sensor[k].translation, atol=1e-12)
            R = Rotation.from_quat(numbers(turn, "xyzw"))
            assert (R.inv() * part.T_world_sensor[k].rotation).magnitude() < 1e-12


def test_the_covariances_of_poses_are_read_back_as_priors(tmp_path: Path) -> None:
    """Of position in the map and of roll, pitch and heading, with different numbers for each."""
    earth = dive()
    part = replace(earth.part, covariances=np.tile(np.diag(np.arange(1.0, 7.0) ** 2 * 1e-6), (6, 1, 1)))
    write_mcap(tmp_path / "map.mcap", earth.folder, part, None)
    T = part.trajectory.T_world_sensor
    scans = scans_at(*part.trajectory.stamps.tolist())
    found = navigate(scans, Path(f"{tmp_path / 'map.mcap'}::/pose")).scans
    for k, prior in enumerate(scan.prior for scan in found):
        assert prior is not None
        np.testing.assert_allclose(values_of(prior.T_world_sensor), values_of(T[k]), atol=1e-6)
        R = T[k].rotation.as_matrix()
        expected = [1e-3, 2e-3, 3e-3, *np.sqrt(np.diag(R @ np.diag([16.0, 25.0, 36.0]) @ R.T)) * 1e-3]
        np.testing.assert_allclose(prior.sigmas, expected, rtol=1e-6)


def test_a_map_far_from_its_origin_has_a_cloud_frame(tmp_path: Path) -> None:
    """UTM coordinates in float32 alone would be off by 0.25 m."""
    earth = dive()
    away = np.array([431_234.5, 6_651_987.25, 0.0])
    T = earth.part.trajectory.T_world_sensor
    moved = RigidTransform.from_components(T.translation + away, T.rotation)
    trajectory = Trajectory(earth.part.trajectory.stamps, moved)
    far = with_part(earth, replace(earth.part, points=earth.part.points + away, trajectory=trajectory))
    topics = messages(tmp_path, far, on_earth=False)
    ((_, tf),) = topics["/tf_static"]
    (transform,) = tf.transforms
    ((_, cloud),) = topics["/map/points"]
    assert (transform.header.frame_id, transform.child_frame_id, cloud.header.frame_id) == ("map",) + ("map_cloud",) * 2
    origin = numbers(transform.transform.translation, "xyz")
    np.testing.assert_allclose(xyz(table(cloud)) + origin, far.part.points, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(numbers(topics["/pose"][2][1].pose.pose.position, "xyz"), moved[2].translation)
    assert "/position" not in topics


def test_counters_are_written_as_ascending_seconds(tmp_path: Path) -> None:
    topics = messages(tmp_path, dive(stamps=np.array([3.0, 4, 5, 0, 1, 2])))
    assert [time for time, _ in topics["/pose"]] == [0, 1, 2, 3, 4, 5]
    first = dive().part.trajectory.T_world_sensor[3].translation
    np.testing.assert_allclose(numbers(topics["/pose"][0][1].pose.pose.position, "xyz"), first)
    assert topics["/map/points"][0][0] == 0


def test_altitudes_are_above_the_ellipsoid(tmp_path: Path) -> None:
    earth = dive()
    here = replace(earth.georeference, vertical="ellipsoid", height=44.5)
    raised = Georeferenced(earth.folder, earth.part, here, earth.projection)
    fixes = [fix for _, fix in messages(tmp_path, raised)["/position"]]
    np.testing.assert_allclose([fix.altitude for fix in fixes], 44.5 - 31.25 + 0.5 * np.arange(6), atol=1e-6)
    variances = np.array([fix.position_covariance for fix in fixes]).reshape(-1, 3, 3)
    np.testing.assert_allclose(np.trace(variances, axis1=1, axis2=2), 0.06)


def test_rosbags_reads_the_poses(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from rosbags.highlevel import AnyReader

    earth = dive()
    write_mcap(tmp_path / "map.mcap", earth.folder, earth.part, earth)
    with AnyReader([tmp_path / "map.mcap"]) as reader:
        read = reader.messages([each for each in reader.connections if each.topic == "/pose"])
        poses: list[Any] = [reader.deserialize(raw, each.msgtype) for each, _, raw in read]
    places = [numbers(pose.pose.pose.position, "xyz") for pose in poses]
    np.testing.assert_allclose(places, earth.part.trajectory.T_world_sensor.translation, atol=1e-12)
    with (tmp_path / "map.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
