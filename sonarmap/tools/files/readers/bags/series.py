"""The numbers of a recording's messages about motion: poses, orientations, fixes, pressures."""

from array import array
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import Recording, Topic, decode, refused, stamp_of

ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped"
FIX, IMU, PRESSURE = "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Imu", "sensor_msgs/msg/FluidPressure"
# Kinds of messages, and the fields whose numbers are read. All but odometry measure the pose in the world.
FIELDS = {
    POSE: ("pose",),  # x, y, z, the quaternion, and 36 covariances of position and rotation
    FIX: ("longitude", "latitude", "status.status", "position_covariance_type", "position_covariance"),
    IMU: ("orientation", "orientation_covariance", "angular_velocity", "linear_acceleration"),
    PRESSURE: ("fluid_pressure", "variance"),
    ODOMETRY: ("pose",),
}
ABSOLUTE = (POSE, FIX, IMU, PRESSURE)
BASE = "base_link"
GRAVITY = 9.80665  # [m/s^2]
_ACCELERATION = 1.0  # [m/s^2], by which the mean specific force may differ from gravity


@dataclass(frozen=True, slots=True)
class Series:
    """The messages of a topic in the order of their stamps."""

    topic: str
    times: np.ndarray  # (n,) float64 [s, UTC], without duplicates
    numbers: np.ndarray  # (n, m) float64, by FIELDS
    frame: str  # in the header of the last message
    child: str  # the moving frame


def _flat(value: Any) -> Iterator[float]:
    """The numbers in a message, or in a part of it, in order."""
    if isinstance(value, int | float):
        yield value
    elif isinstance(value, np.ndarray):
        yield from value.tolist()
    elif not isinstance(value, str):
        for field in fields(value):
            yield from _flat(getattr(value, field.name))


def series_of(recording: Recording, topic: Topic, faults: list[str]) -> Series:
    """The readable messages of a topic of FIELDS; damage is appended to `faults`."""
    times, numbers, frame, child = array("d"), array("d"), "", ""
    for number, message in enumerate(recording.messages([topic.name], faults)):
        try:
            content = decode(message)
            with refused(f"its {topic.kind} contradicts itself"):
                row = [each for name in FIELDS[topic.kind] for each in _flat(attrgetter(name)(content))]
                frame = content.header.frame_id.lstrip("/")
                child = BASE if topic.kind == POSE else getattr(content, "child_frame_id", frame).lstrip("/")
                times.append((stamp_of(content.header) or message.time) / 10**9)
                numbers.extend(row)
        except InputError as error:
            faults.append(f"message {number} of {topic.name}: {error}")
    if not times:
        raise InputError(f"{topic.name} cannot be read" + (f": {faults[0]}" if faults else "; record it again"))
    kept, first = np.unique(np.frombuffer(times), return_index=True)
    return Series(topic.name, kept, np.frombuffer(numbers).reshape(len(times), -1)[first], frame, child)


def up_in(recording: Recording, frame: str) -> np.ndarray:
    """The direction (3,) of the mean specific force of an IMU in a frame, which points up; 0 if there is none."""
    for topic in recording.of_kinds((IMU,)):
        with suppress(InputError):  # damaged as a whole
            series = series_of(recording, topic, [])
            forces = series.numbers[(np.abs(series.numbers[:, 16:]) < 10 * GRAVITY).all(axis=1), 16:]
            mean = forces.mean(axis=0) if len(forces) else np.zeros(3)
            if series.frame == frame and abs(np.linalg.norm(mean) - GRAVITY) < _ACCELERATION:
                return mean / np.linalg.norm(mean)
    return np.zeros(3)
