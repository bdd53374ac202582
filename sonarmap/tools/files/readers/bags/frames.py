"""Coordinate frames of a recording: transforms from a sensor's frame to the vehicle's, by tf_static or by the frame's
name (REP-103); odometry, from nav_msgs/Odometry; and turn rates, from sensor_msgs/Imu.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.bags.open import open_recording
from sonarmap.tools.files.readers.bags.recording import (
    IMU,
    ODOMETRY,
    TRANSFORMS,
    Recording,
    choose_topic,
    decode,
    refused,
)
from sonarmap.tools.files.readers.instruments import LARGEST
from sonarmap.tools.files.user_file import naming

BASE = "base_link"
# Rotations to x forward, y left, z up, by suffix of a frame's name. Optical frames have x right, y down, z forward.
_OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
_DOWN = Rotation.from_matrix(np.diag([1, -1, -1]))
R_FLU = {"_optical_frame": _OPTICAL, "_optical": _OPTICAL, "_frd": _DOWN, "_ned": _DOWN}
_NAMED = 3  # faults that are listed
_R_ENU_NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


@dataclass(frozen=True, slots=True)
class Link:
    """A transform of tf_static."""

    parent: str  # name of the parent frame
    child: str  # name of the child frame
    numbers: tuple[float, ...]  # T_parent_child as x, y, z [m] and the quaternion x, y, z, w

    def T_parent_child(self) -> RigidTransform:
        return rigid([self.numbers], f"the transform {self.parent} to {self.child}")[0]


def numbers_of(place: Any, turn: Any) -> tuple[float, ...]:
    """Numbers (7,) of a message's position x, y, z and quaternion x, y, z, w."""
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def stamp_of(header: Any) -> int:
    """The stamp of a ROS header [ns since 1970]; 0 if it has none."""
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def rigid(rows: Sequence[tuple[float, ...]], what: str) -> RigidTransform:
    """Transforms of rows of x, y, z [m] and a unit quaternion; `what` is named in errors."""
    numbers = np.array(rows, np.float64)
    length = np.linalg.norm(np.clip(numbers[:, 3:], -2, 2), axis=1)  # clipped, as squares may overflow
    good = (np.abs(numbers[:, :3]) <= LARGEST).all(axis=1) & (length > 0.5) & (length < 2)
    if not good.all():
        bad = int(np.argmin(good))
        shown = " ".join(f"{number:g}" for number in numbers[bad])
        raise InputError(f"{what} (number {bad}) is {shown}; wanted meters and a unit quaternion: record it again")
    return RigidTransform.from_components(numbers[:, :3], Rotation.from_quat(numbers[:, 3:]))


def links(recording: Recording, faults: list[str]) -> Iterator[Link]:
    """Yield all transforms of the topics called tf_static, in any namespace."""
    names = [topic.name for topic in recording.of_kinds((TRANSFORMS,)) if topic.name.split("/")[-1] == "tf_static"]
    for message in recording.messages(names, faults) if names else ():
        try:
            with refused("its transforms contradict each other"):
                for stamped in decode(message).transforms:
                    parent, child = stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/")
                    numbers = numbers_of(stamped.transform.translation, stamped.transform.rotation)
                    yield Link(parent, child, numbers)
        except InputError as error:
            faults.append(f"{message.topic}: {error}")


def is_named(frame: str, name: str) -> bool:
    """Whether a frame has this name, in any namespace: rov/base_link is base_link."""
    return frame.split("/")[-1] == name


class Frames:
    """The mounting of sensors by a recording's tf_static; `notes` has a message about each frame that was transformed,
    and about damage of tf_static."""

    def __init__(self, recording: Recording) -> None:
        self.notes: list[str] = []
        self._links = {(link.child, link.parent): link for link in links(recording, self.notes)}
        self._known: dict[str, RigidTransform] = {}

    def T_base(self, frame: str) -> RigidTransform:
        """T_base_frame to base_link if tf_static has it, otherwise the rotation to x forward, y left, z up."""
        if frame not in self._known:
            self._known[frame] = self._to_base(frame)
        return self._known[frame]

    def _to_base(self, frame: str) -> RigidTransform:
        base, T = self._by_tf(frame)
        if base and base != frame:
            yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True)
            x, y, z = T.translation
            where = f"{x:.3f}, {y:.3f}, {z:.3f} m, with roll {roll:.2f}, pitch {pitch:.2f}, yaw {yaw:.2f} degrees"
            self.notes.append(f"points are in {base}, by tf_static: {frame} is there at {where}")
        suffix = "" if base else next((suffix for suffix in R_FLU if frame.endswith(suffix)), "")
        if not suffix:
            return T
        self.notes.append(f"points in {frame} are turned to x forward, y left, z up, as its name {suffix} says")
        return RigidTransform.from_rotation(R_FLU[suffix])

    def _by_tf(self, frame: str) -> tuple[str, RigidTransform]:
        """The nearest frame called base_link, and T_base_frame; "" and the identity if there is none."""
        neighbors: dict[str, list[tuple[str, Link, bool]]] = {}
        for link in self._links.values():
            neighbors.setdefault(link.child, []).append((link.parent, link, True))
            neighbors.setdefault(link.parent, []).append((link.child, link, False))
        waiting, seen = deque([(frame, RigidTransform.identity())]), {frame}
        while waiting:
            here, T_here_frame = waiting.popleft()
            if is_named(here, BASE):
                return here, T_here_frame
            for there, link, up in neighbors.get(here, []):
                if there not in seen:
                    seen.add(there)
                    T_there_here = link.T_parent_child() if up else link.T_parent_child().inv()
                    waiting.append((there, T_there_here * T_here_frame))
        return "", RigidTransform.identity()


def read_recorded_odometry(path: Path, topic: str | None, notes: list[str]) -> Trajectory:
    """Read odometry as T_odom_base with ascending stamps, transformed to base_link if tf_static has the moving frame.
    `topic`: of nav_msgs/Odometry; None for the only one."""
    with naming(path):
        faults: list[str] = []
        recording = open_recording(path)
        trajectory = _of_odometry(recording, choose_topic(recording, topic, (ODOMETRY,), path).name, faults)
        notes += [f"{path}: {fault}" for fault in faults[:_NAMED]]
    return trajectory


def _of_odometry(recording: Recording, topic: str, faults: list[str]) -> Trajectory:
    stamps, rows = list[int](), list[tuple[float, ...]]()
    world = child = ""
    for number, message in enumerate(recording.messages([topic], faults)):
        content = decode(message)
        with refused(f"message {number} of {topic} contradicts itself"):
            stamps.append(stamp_of(content.header) or message.time)
            rows.append(numbers_of(content.pose.pose.position, content.pose.pose.orientation))
            world, child = content.header.frame_id, content.child_frame_id.lstrip("/")
    T_base_child = Frames(recording).T_base(child)
    trajectory = _ascending(stamps, rows, f"the pose of {topic}", faults)
    R_enu_world = _R_ENU_NED if world.endswith("_ned") else Rotation.identity()
    T = RigidTransform.from_rotation(R_enu_world) * trajectory.T_world_sensor * T_base_child.inv()
    return Trajectory(trajectory.stamps, T)


def _ascending(stamps: Sequence[int], rows: Sequence[tuple[float, ...]], what: str, faults: list[str]) -> Trajectory:
    """The trajectory of rows sorted by stamp [ns], without duplicate stamps."""
    if not rows:
        raise InputError(f"{what} cannot be read" + (f": {faults[0]}" if faults else "; record it again"))
    kept, indices = np.unique(np.array(stamps, dtype=np.int64), return_index=True)
    return Trajectory(kept / 1e9, rigid(rows, what)[indices])


def recorded_turn_rates(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Ascending times (n,) [s, UTC] and turn rates (n, 3) [rad/s] of the sensor_msgs/Imu topic with the most messages,
    about the axes of base_link if tf_static has the IMU's mounting, otherwise of its own frame (x forward, y left, z
    up)."""
    with naming(path):
        recording = open_recording(path)
        topics = recording.of_kinds((IMU,))
        if not topics:
            raise InputError(f"it has no messages of type {IMU}")
        frames, rows = Frames(recording), list[tuple[float, float, float, float]]()
        frame = ""
        for message in recording.messages([max(topics, key=lambda topic: topic.count).name], []):
            with suppress(InputError):  # damage is reported when the scans are read
                content = decode(message)
                rate, frame = content.angular_velocity, content.header.frame_id.lstrip("/")
                rows.append(((stamp_of(content.header) or message.time) / 10**9, rate.x, rate.y, rate.z))
        table = np.array(rows, np.float64).reshape(-1, 4)
        table = table[np.isfinite(table).all(axis=1)]
        if not len(table):
            raise InputError(f"none of its messages of type {IMU} can be read")
        times, first = np.unique(table[:, 0], return_index=True)
        return times, frames.T_base(frame).rotation.apply(table[first, 1:])
