"""Coordinate frames of a recording: transforms from a sensor's frame to the vehicle's, by tf_static or by the frame's
name (REP-103)."""

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import TRANSFORMS, Recording, decode, refused
from sonarmap.tools.files.readers.bags.series import BASE, up_in
from sonarmap.tools.files.readers.clouds.axes import axes_matrix
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.instruments import LARGEST

DOWN = Rotation.from_matrix(np.diag([1, -1, -1]))
_AXES = {"_optical_frame": "rdf", "_optical": "rdf", "_frd": "frd", "_ned": "frd"}  # by suffix of a frame's name
# Water Linked's driver of the Sonar 3D-15 publishes z down in this frame and topic, and a fork of it z up.
_OPEN_FRAME, _OPEN_TOPIC = "sonar_frame", "sonar_point_cloud"
_ASKED = (
    "points in {} may be x forward, y right, z down, as by Water Linked's ROS driver, or x forward, y left, z up, as "
    "by others; say which: `frame=frd` or `frame=flu`"
)
_UPRIGHT = 0.7  # cosine of the angle between z and gravity from which z points up or down


def numbers_of(place: Any, turn: Any) -> tuple[float, ...]:
    """Numbers (7,) of a message's position x, y, z and quaternion x, y, z, w."""
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def are_rigid(numbers: np.ndarray) -> np.ndarray:
    """(n,) bool: rows (n, 7) of x, y, z [m] and a unit quaternion."""
    length = np.linalg.norm(np.clip(numbers[:, 3:], -2, 2), axis=1)  # clipped, as squares may overflow
    return (np.abs(numbers[:, :3]) <= LARGEST).all(axis=1) & (length > 0.5) & (length < 2)


def rigid(numbers: np.ndarray, what: str) -> RigidTransform:
    """Transforms of rows (n, 7) of x, y, z [m] and a unit quaternion; `what` is named in errors."""
    good = are_rigid(numbers)
    if not good.all():
        bad = int(np.argmin(good))
        shown = " ".join(f"{number:g}" for number in numbers[bad])
        raise InputError(f"{what} (number {bad}) is {shown}; wanted meters and a unit quaternion: record it again")
    return RigidTransform.from_components(numbers[:, :3], Rotation.from_quat(numbers[:, 3:]))


def is_named(frame: str, name: str) -> bool:
    """Whether a frame has this name, in any namespace: rov/base_link is base_link."""
    return frame.split("/")[-1] == name


class Frames:
    """The mounting of sensors by a recording's tf_static; `notes` has a message about each frame that was transformed,
    and about damage of tf_static."""

    def __init__(self, recording: Recording) -> None:
        self.notes: list[str] = []
        self._recording = recording
        self._known: dict[tuple[str, str], tuple[str, RigidTransform]] = {}
        # {frame: {neighbor: (parent, child, numbers (7,) of T_parent_child)}}
        self._neighbors: dict[str, dict[str, tuple[str, str, tuple[float, ...]]]] = {}
        self._read_links()

    def _read_links(self) -> None:
        """Read all transforms of the topics called tf_static, in any namespace."""
        names = [topic.name for topic in self._recording.of_kinds((TRANSFORMS,)) if is_named(topic.name, "tf_static")]
        for message in self._recording.messages(names, self.notes) if names else ():
            try:
                with refused("its transforms contradict each other"):
                    for stamped in decode(message).transforms:
                        parent, child = stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/")
                        numbers = numbers_of(stamped.transform.translation, stamped.transform.rotation)
                        for here, there in ((parent, child), (child, parent)):
                            self._neighbors.setdefault(here, {})[there] = parent, child, numbers
            except InputError as error:
                self.notes.append(f"{message.topic}: {error}")

    def T_base(self, frame: str) -> RigidTransform:
        """T_base_frame to base_link if tf_static has it, otherwise the rotation to x forward, y left, z up."""
        axes, T_base_flu = self._axes_and_mount(frame)
        return T_base_flu * RigidTransform.from_rotation(Rotation.from_matrix(axes_matrix(axes or "flu")))

    def placed(self, cloud: Cloud, frame: str, topic: str) -> Cloud:
        """The cloud with its axes, and its place in base_link if tf_static has it."""
        axes, T_base_flu = self._axes_and_mount(frame, topic)
        question = "" if axes else _ASKED.format(frame)
        return replace(cloud, axes=axes or "flu", question=question, T_base_flu=T_base_flu)

    def _axes_and_mount(self, frame: str, topic: str = "") -> tuple[str, RigidTransform]:
        """The axes of a frame, a name for `axes_matrix`, or "" if they are not known; and T_base_flu."""
        if (frame, topic) in self._known:
            return self._known[frame, topic]
        base, T = self._by_tf(frame)
        suffix = next((suffix for suffix in _AXES if frame.endswith(suffix)), "")
        axes = _AXES.get(suffix, "flu")
        if base and base != frame:
            yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True)
            x, y, z = T.translation
            where = f"{x:.3f}, {y:.3f}, {z:.3f} m, with roll {roll:.2f}, pitch {pitch:.2f}, yaw {yaw:.2f} degrees"
            self.notes.append(f"points are in {base}, by tf_static: {frame} is there at {where}")
            T = T * RigidTransform.from_rotation(Rotation.from_matrix(axes_matrix(axes).T))
        elif suffix:
            self.notes.append(f"points in {frame} are turned to x forward, y left, z up, as its name {suffix} says")
        elif not base and (is_named(frame, _OPEN_FRAME) or is_named(topic, _OPEN_TOPIC)):
            up = float(up_in(self._recording, frame)[2])
            axes = "" if abs(up) < _UPRIGHT else "flu" if up > 0 else "frd"
            if axes:
                side = "up" if up > 0 else "down"
                self.notes.append(f"points in {frame} have z {side}, as the gravity shows that its IMU measured")
        self._known[frame, topic] = axes, T
        return axes, T

    def _by_tf(self, frame: str) -> tuple[str, RigidTransform]:
        """The nearest frame called base_link, and T_base_frame; "" and the identity if there is none."""
        waiting, seen = deque([(frame, RigidTransform.identity())]), {frame}
        while waiting:
            here, T_here_frame = waiting.popleft()
            if is_named(here, BASE):
                return here, T_here_frame
            for there, (parent, child, numbers) in self._neighbors.get(here, {}).items():
                if there not in seen:
                    seen.add(there)
                    T_parent_child = rigid(np.array([numbers]), f"the transform {parent} to {child}")[0]
                    T_there_here = T_parent_child if there == parent else T_parent_child.inv()
                    waiting.append((there, T_there_here * T_here_frame))
        return "", RigidTransform.identity()
