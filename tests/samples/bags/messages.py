"""Messages as dictionaries: points packed in every layout, odometry and transforms."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.samples.cloud_files import TABLE

CLOUD, ODOMETRY, TF = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
IMU, FIX, PRESSURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/FluidPressure"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
# Fields out of order, an unused one, gaps between them: name, dtype, offset.
FIELDS = (("intensity", "f4", 2), ("x", "f4", 8), ("ring", "u2", 12), ("z", "f4", 16), ("y", "f4", 24))
STEP = 30
STAMP = 1_700_000_000


def header(stamp: float, frame: str) -> dict[str, Any]:
    """A header; stamps in multiples of 1/8 s are not rounded."""
    return {"stamp": {"sec": int(stamp), "nanosec": round((stamp - int(stamp)) * 1e9)}, "frame_id": frame}


def cloud(
    table: np.ndarray = TABLE,
    stamp: float = STAMP + 0.25,
    frame: str = "sonar_link",
    names: Sequence[str] = ("x", "y", "z", "intensity"),
    fields: Sequence[tuple[str, str, int]] = FIELDS,
    step: int = STEP,
    rows: int = 1,
    padding: int = 0,
    big: bool = False,
    dense: bool = True,
) -> dict[str, Any]:
    """A PointCloud2 of the columns of a table in rows, with bytes of 0xAA wherever there is no field."""
    order = ">" if big else "<"
    width = len(table) // rows
    points = np.full((rows, width, step), 0xAA, np.uint8)
    for name, dtype, offset in fields:
        if name in names:
            column = table[:, list(names).index(name)].astype(order + dtype)
            size = column.dtype.itemsize
            points[:, :, offset : offset + size] = column.view(np.uint8).reshape(rows, width, size)
    content = np.full((rows, width * step + padding), 0xBB, np.uint8)
    content[:, : width * step] = points.reshape(rows, -1)
    return {
        "header": header(stamp, frame),
        "height": rows,
        "width": width,
        "fields": [
            {"name": name, "offset": offset, "datatype": NUMBERS[dtype], "count": 1} for name, dtype, offset in fields
        ],
        "is_bigendian": big,
        "point_step": step,
        "row_step": width * step + padding,
        "data": content.tobytes(),
        "is_dense": dense,
    }


def odometry(
    stamp: float, place: Sequence[float], turn: Sequence[float], frame: str = "odom", child: str = "base_link"
) -> dict[str, Any]:
    """A pose with a quaternion x, y, z, w."""
    pose = {"position": xyz(place), "orientation": xyz(turn, "xyzw")}
    return {"header": header(stamp, frame), "child_frame_id": child, "pose": {"pose": pose}}


def transforms(*links: tuple[float, str, str, Sequence[float], Sequence[float]]) -> dict[str, Any]:
    """A TFMessage of (stamp, parent, child, place, quaternion)."""
    return {
        "transforms": [
            {
                "header": header(stamp, parent),
                "child_frame_id": child,
                "transform": {"translation": xyz(place), "rotation": xyz(turn, "xyzw")},
            }
            for stamp, parent, child, place, turn in links
        ]
    }


def xyz(values: Sequence[float], names: str = "xyz") -> dict[str, float]:
    """Numbers keyed by their names."""
    return dict(zip(names, map(float, values), strict=True))


def imu(
    stamp: float,
    turn: Sequence[float] = (0, 0, 0, 0),
    variances: Sequence[float] = (0, 0, 0),
    force: Sequence[float] = (0, 0, 0),
    frame: str = "base_link",
) -> dict[str, Any]:
    """An orientation with the variances of roll, pitch and yaw, and a specific force."""
    covariance = np.diag(np.array(variances, float)).ravel().tolist()
    parts = {"orientation": xyz(turn, "xyzw"), "linear_acceleration": xyz(force)}
    return {"header": header(stamp, frame), **parts, "orientation_covariance": covariance}


def fix(
    stamp: float, latitude: float, longitude: float, variances: Sequence[float], frame: str = "base_link"
) -> dict[str, Any]:
    """A fix with the variances of East, North and Up; a status of -1 for none at the latitude 0."""
    status = {"status": 0 if latitude else -1, "service": 1}
    place = {"latitude": latitude, "longitude": longitude, "altitude": 45.5, "position_covariance_type": 2}
    covariance = np.diag(np.array(variances, float)).ravel().tolist()
    return {"header": header(stamp, frame), "status": status, **place, "position_covariance": covariance}


def pressure(stamp: float, pascal: float, variance: float = 0.0, frame: str = "base_link") -> dict[str, Any]:
    return {"header": header(stamp, frame), "fluid_pressure": pascal, "variance": variance}


def pose(
    stamp: float, place: Sequence[float], turn: Sequence[float], covariance: np.ndarray, frame: str = "map"
) -> dict[str, Any]:
    """A pose with its covariance (6, 6): x, y, z, roll, pitch, yaw."""
    placed = {"position": xyz(place), "orientation": xyz(turn, "xyzw")}
    return {"header": header(stamp, frame), "pose": {"pose": placed, "covariance": covariance.ravel().tolist()}}
