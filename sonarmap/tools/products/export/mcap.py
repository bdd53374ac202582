"""The map, its track and poses over time as MCAP with messages of ROS 2.

They are no Foxglove messages, so that RViz, `ros2 bag`, rosbags and evo read them as well as Foxglove and Rerun.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.user_file import package_versions
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.points import float32_origin, pack_records
from sonarmap.tools.files.writers.poses import pose_numbers
from sonarmap.tools.products.export.georeferenced import Georeferenced

if TYPE_CHECKING:
    from mcap.writer import Writer

MAP, CLOUD, SENSOR = "map", "map_cloud", "sensor"  # frames
_DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}  # of sensor_msgs/PointField
_KNOWN = 3  # NavSatFix.COVARIANCE_TYPE_KNOWN


def write_mcap(path: Path, folder: Map, part: MapPart, earth: Georeferenced | None) -> None:
    """Write cloud and track at the first stamp, poses at their stamps, and with `earth` positions too."""
    from mcap.writer import Writer

    with atomic_path(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library=f"sonarmap {package_versions()['sonarmap']}")
        ros = _Ros(writer)
        first = float(part.trajectory.stamps.min())
        _write_clouds(ros, part, first)
        _write_poses(ros, part, first)
        if earth is not None:
            _write_positions(ros, earth)
        writer.finish()


class _Ros:
    """Messages of ROS 2 in an MCAP file: `write` takes a message's fields, `make` builds the messages inside it."""

    def __init__(self, writer: "Writer") -> None:
        from rosbags.typesys import Stores, get_typestore

        self._writer = writer
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        self._channels: dict[str, int] = {}

    def make(self, name: str, *fields: Any) -> Any:
        """A message of the named type, such as geometry_msgs/msg/Point, with its fields in order."""
        return self._types.types[name](*fields)

    def header(self, stamp: float, frame: str) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(stamp), 10**9)
        time = self.make("builtin_interfaces/msg/Time", seconds, nanoseconds)
        return self.make("std_msgs/msg/Header", time, frame)

    def placed(self, kind: str, vector_kind: str, numbers: Sequence[float]) -> Any:
        """A Pose with a Point, or a Transform with a Vector3, of x, y, z and the quaternion x, y, z, w."""
        position = self.make(f"geometry_msgs/msg/{vector_kind}", *numbers[:3])
        quaternion = self.make("geometry_msgs/msg/Quaternion", *numbers[3:])
        return self.make(f"geometry_msgs/msg/{kind}", position, quaternion)

    def transforms(self, stamp: float, child: str, numbers: Sequence[float]) -> Any:
        """A TFMessage with T_map_child: x, y, z and the quaternion x, y, z, w."""
        transform = self.placed("Transform", "Vector3", numbers)
        stamped = self.make("geometry_msgs/msg/TransformStamped", self.header(stamp, MAP), child, transform)
        return self.make("tf2_msgs/msg/TFMessage", [stamped])

    def write(self, topic: str, stamp: float, message: Any) -> None:
        if topic not in self._channels:
            name: str = message.__msgtype__
            definition, _ = self._types.generate_msgdef(name, ros_version=2)
            schema = self._writer.register_schema(name, "ros2msg", definition.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        time = _nanoseconds(stamp)
        content = bytes(self._types.serialize_cdr(message, message.__msgtype__))
        self._writer.add_message(self._channels[topic], time, content, time)


def _nanoseconds(stamp: float) -> int:
    return round(stamp * 1e9)


def _write_clouds(ros: _Ros, part: MapPart, first: float) -> None:
    """Write map and track in float32, as viewers need it; a map far from the origin has a frame of its own."""
    origin = float32_origin(part.points)
    frame = CLOUD if origin.any() else MAP
    if frame == CLOUD:
        ros.write("/tf_static", first, ros.transforms(first, CLOUD, [*origin.tolist(), 0.0, 0.0, 0.0, 1.0]))
    track, scans = part.trajectory.T_world_sensor.translation, np.array(part.scans, np.int32)
    header = ros.header(first, frame)
    ros.write("/map/points", first, _cloud(ros, header, part.points - origin, part.columns))
    ros.write("/track/points", first, _cloud(ros, header, track - origin, {"scan": scans}))  # Rerun draws no Path


def _cloud(ros: _Ros, header: Any, points: np.ndarray, columns: Mapping[str, np.ndarray]) -> Any:
    """A PointCloud2 of points (N, 3) [m] with further columns {name: (N,)}."""
    records = pack_records(points.astype(np.float32), columns)
    dtypes = [records.dtype[name] for name in records.dtype.names or ()]
    ends = np.cumsum([dtype.itemsize for dtype in dtypes]).tolist()
    fields = [
        ros.make("sensor_msgs/msg/PointField", name, end - dtype.itemsize, _DATATYPES[dtype.str[1:]], 1)
        for name, dtype, end in zip(records.dtype.names or (), dtypes, ends, strict=True)
    ]
    size = (len(records), fields, False, ends[-1], ends[-1] * len(records))
    return ros.make("sensor_msgs/msg/PointCloud2", header, 1, *size, records.view(np.uint8), True)


def _write_poses(ros: _Ros, part: MapPart, first: float) -> None:
    """Write the track in the order of the survey, then poses and transforms in the order of time."""
    stamps, numbers = part.trajectory.stamps.tolist(), pose_numbers(part.trajectory.T_world_sensor).tolist()
    poses = [
        ros.make("geometry_msgs/msg/PoseStamped", ros.header(stamp, MAP), ros.placed("Pose", "Point", pose))
        for stamp, pose in zip(stamps, numbers, strict=True)
    ]
    to_ros = np.zeros_like(part.covariances)  # of position in the map, then of roll, pitch and yaw
    to_ros[:, :3, 3:], to_ros[:, 3:, :3] = part.trajectory.T_world_sensor.rotation.as_matrix(), np.eye(3)
    covariances = to_ros @ part.covariances @ to_ros.mT
    ros.write("/track", first, ros.make("nav_msgs/msg/Path", ros.header(first, MAP), poses))
    for k in np.argsort(part.trajectory.stamps, kind="stable").tolist():
        ros.write("/tf", stamps[k], ros.transforms(stamps[k], SENSOR, numbers[k]))
        placed = ros.make("geometry_msgs/msg/PoseWithCovariance", poses[k].pose, covariances[k].ravel())
        message = ros.make("geometry_msgs/msg/PoseWithCovarianceStamped", poses[k].header, placed)
        ros.write("/pose", stamps[k], message)


def _write_positions(ros: _Ros, earth: Georeferenced) -> None:
    """Write NavSatFix; its altitude is NaN unless heights count from the WGS84 ellipsoid."""
    status = ros.make("sensor_msgs/msg/NavSatStatus", 0, 0)
    for k in earth.in_time:
        stamp = float(earth.stamps[k])
        latitude, longitude, height = earth.poses[k].tolist()
        altitude = height if earth.georeference.vertical == "ellipsoid" else float("nan")
        covariance = earth.covariances[k, :3, :3].reshape(9)
        place = (ros.header(stamp, SENSOR), status, latitude, longitude, altitude, covariance, _KNOWN)
        ros.write("/position", stamp, ros.make("sensor_msgs/msg/NavSatFix", *place))
