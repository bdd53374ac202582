"""Dead reckoning in a recording: its messages of nav_msgs/Odometry, or what tf says of odom and base_link."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.bags.frames import BASE, Frames, Link, is_named, links, numbers_of, rigid, stamp_of
from sonarmap.tools.files.readers.bags.open import open_recording
from sonarmap.tools.files.readers.bags.recording import (
    ODOMETRY,
    TRANSFORMS,
    Recording,
    choose_topic,
    decode,
    listed,
    refused,
)
from sonarmap.tools.files.readers.poses.trajectory import poses_at
from sonarmap.tools.files.user_file import naming

_ODOM = "odom"
_NAMED = 3  # faults that are named
_R_ENU_NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def read_recorded_odometry(path: Path, topic: str | None, notes: list[str]) -> Trajectory:
    """Where dead reckoning had the vehicle: T_odom_base with stamps that ascend; of base_link where tf_static has the
    frame that moves. `topic`: of nav_msgs/Odometry; None for the only one, or for tf where there is none. Raises
    InputError: naming the file: there is no odometry in it, or several of which none is named."""
    with naming(path):
        faults: list[str] = []
        recording = open_recording(path, faults)
        if topic is None and not recording.of_kinds((ODOMETRY,)):
            trajectory = _of_tf(recording, faults)
        else:
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


def _of_tf(recording: Recording, faults: list[str]) -> Trajectory:
    """The chain from odom to base_link, at the times of its link that moves most often."""
    by_child: dict[str, dict[str, list[Link]]] = {}
    for name in ("tf_static", "tf"):
        for link in links(recording, name, faults):
            by_child.setdefault(link.child, {}).setdefault(link.parent, []).append(link)
    chain: list[list[Link]] = []
    here = next((child for child in by_child if is_named(child, BASE)), "")
    while here in by_child and len(chain) < len(by_child):
        here, steps = next(iter(by_child[here].items()))
        chain.insert(0, steps)
        if is_named(here, _ODOM):
            return _composed(chain, faults)
    raise InputError(
        f"there is no odometry in it: no message of {ODOMETRY}, and no transform of {TRANSFORMS} from {_ODOM} to "
        f"{BASE}; its topics are {listed(recording.topics)}"
    )


def _composed(chain: Sequence[Sequence[Link]], faults: list[str]) -> Trajectory:
    """T of the whole chain, where all of its links that move are known."""
    parts: list[Trajectory] = []
    for steps in chain:
        stamps, rows = [link.stamp for link in steps], [link.numbers for link in steps]
        parts.append(_ascending(stamps, rows, f"the transform {steps[0].parent} to {steps[0].child}", faults))
    moving = [part for part, steps in zip(parts, chain, strict=True) if not steps[-1].fixed]
    if not moving:
        raise InputError(f"in its tf {BASE} does not move in {_ODOM}; record tf too, not only tf_static")
    times = max(moving, key=len).stamps
    first, last = max(part.stamps[0] for part in moving), min(part.stamps[-1] for part in moving)
    times = times[(times >= first) & (times <= last)]
    if len(times) == 0:
        raise InputError("the transforms of its tf were recorded at times that do not overlap; record them together")
    T = RigidTransform.identity(len(times))
    for part, steps in zip(parts, chain, strict=True):
        stands = steps[-1].fixed or len(part) == 1
        T = T * (part.T_world_sensor[-1] if stands else poses_at(part, times))
    return Trajectory(times, T)


def _ascending(stamps: Sequence[int], rows: Sequence[tuple[float, ...]], what: str, faults: list[str]) -> Trajectory:
    """Poses in the order of their stamps [ns], each once."""
    if not rows:
        raise InputError(f"{what} cannot be read" + (f": {faults[0]}" if faults else "; record it again"))
    kept, indices = np.unique(np.array(stamps, dtype=np.int64), return_index=True)
    return Trajectory(kept / 1e9, rigid(rows, what)[indices])
