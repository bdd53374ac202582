"""Reading clouds of a ROS bag or MCAP file, one per message (sensor_msgs/PointCloud2 or foxglove.PointCloud)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.frames import Frames, numbers_of
from sonarmap.tools.files.readers.bags.open import open_mcap, open_recording
from sonarmap.tools.files.readers.bags.recording import (
    FOXGLOVE_CLOUD,
    POINT_CLOUD,
    Message,
    choose_topic,
    decode,
    refused,
    stamp_of,
)
from sonarmap.tools.files.readers.clouds.cloud import Cloud, cloud_of_columns, column_roles

_NAMED = 3  # notes or faults of a kind that are listed
CLOUD_KINDS = (POINT_CLOUD, FOXGLOVE_CLOUD)

# Data types of fields by their number in sensor_msgs/PointField and in foxglove.PackedElementField
_ROS_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_FOXGLOVE_TYPES = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}
_SECONDS_PER_COUNT = 1e-9  # unit of times that are integers, or floats beyond _LARGEST_SECONDS
_LARGEST_SECONDS, _SINCE_THE_STAMP = 1e14, 1e6  # times below the latter are relative to the message's stamp [s]


def stream_recording(
    path: Path, topic: str | None, notes: list[str], more: Callable[[], bool] | None = None
) -> Iterator[Cloud]:
    """Yield a cloud for each message of a topic (None: the only one with clouds), with its header's stamp, axes and
    mounting; an empty cloud for an unusable message. `more`: see `open_mcap`, for an MCAP file that grows."""
    recording = open_recording(path)
    chosen = choose_topic(recording, topic, CLOUD_KINDS, path)
    frames, faults = Frames(recording), list[str]()
    if more is not None:
        recording = open_mcap(path, path.stat().st_size, more)
    usable = unstamped = 0
    for number, message in enumerate(recording.messages([chosen.name], faults)):
        try:
            frame, cloud = cloud_of(message)
            cloud = frames.placed(cloud, frame, chosen.name)
        except InputError as error:
            faults.append(f"message {number} of {chosen.name}: {error}")
            yield Cloud(np.empty((0, 3), np.float32), stamp=message.time / 10**9)
            continue
        usable += 1
        unstamped += cloud.stamp is None
        yield replace(cloud, stamp=message.time / 10**9) if cloud.stamp is None else cloud
    if not usable:
        raise InputError(faults[0] if faults else f"no message of {chosen.name} can be read; record it again")
    if unstamped:
        frames.notes.append(f"{unstamped:,} headers have no stamp: the times are those at which they were recorded")
    once = dict.fromkeys(_shortened(frames.notes) + _shortened(faults))  # both passes may find the same damage
    notes += [f"{path.name}: {note}" for note in once]


def _shortened(notes: list[str]) -> list[str]:
    return [*notes[:_NAMED], f"and {len(notes) - _NAMED:,} more of these"] if len(notes) > _NAMED + 1 else notes


@dataclass(frozen=True, slots=True)
class _Packed:
    """The packed points of a message."""

    fields: dict[str, tuple[str, int]]  # {name: (dtype, offset)}; the dtype is empty if its number is unknown
    shape: tuple[int, int]  # number of rows, and of points per row
    strides: tuple[int, int]  # bytes from row to row, and from point to point
    content: np.ndarray  # (B,) uint8
    has_gaps: bool  # whether points that are not finite stand for beams without an echo


def cloud_of(message: Message) -> tuple[str, Cloud]:
    """The frame name and the cloud of a message; the cloud has no stamp if the message has none."""
    content = decode(message)
    with refused(f"its {message.kind} contradicts itself"):
        if message.kind == FOXGLOVE_CLOUD:
            stamp = content.timestamp.seconds * 10**9 + content.timestamp.nanos
            return content.frame_id.lstrip("/"), _moved(_cloud(_packed_by_foxglove(content), stamp), content)
        return content.header.frame_id.lstrip("/"), _cloud(_packed_by_ros(content), stamp_of(content.header))


def _packed_by_ros(content: Any) -> _Packed:
    order = ">" if content.is_bigendian else "<"
    single = [(field.name, field.datatype, field.offset) for field in content.fields if field.count <= 1]
    # drivers leave the row step of a cloud with a single row at 0
    row_step = content.row_step if content.height != 1 else content.row_step or content.width * content.point_step
    shape, strides = (content.height, content.width), (row_step, content.point_step)
    octets = np.asarray(content.data, np.uint8)
    return _Packed(_layout(single, _ROS_TYPES, order), shape, strides, octets, has_gaps=not content.is_dense)


def _packed_by_foxglove(content: Any) -> _Packed:
    fields = [(field.name, field.type, field.offset) for field in content.fields]
    stride, octets = content.point_stride, np.frombuffer(content.data, np.uint8)
    if stride < 1 or len(octets) % stride:
        raise InputError(f"it holds {len(octets):,} bytes, which is no multiple of its point size, {stride:,} bytes")
    shape, strides = (1, len(octets) // stride), (len(octets), stride)
    return _Packed(_layout(fields, _FOXGLOVE_TYPES, "<"), shape, strides, octets, has_gaps=True)


def _layout(fields: list[tuple[str, int, int]], types: dict[int, str], order: str) -> dict[str, tuple[str, int]]:
    return {name: (order + types[kind] if kind in types else "", offset) for name, kind, offset in fields}


def _cloud(packed: _Packed, stamp: int) -> Cloud:
    """The cloud of packed points; `stamp` [ns] is 0 if there is none."""
    seconds = stamp / 10**9 if stamp else None
    if 0 in packed.shape:
        return Cloud(np.empty((0, 3), np.float32), stamp=seconds)
    names = list(packed.fields)
    layout = {role: packed.fields[names[column]] for role, column in column_roles(names).items()}
    unknown = [names[column] for column in column_roles(names).values() if not packed.fields[names[column]][0]]
    if unknown:
        raise InputError(f"its field {unknown[0]} has an unknown data type; wanted integers or floats")
    _require_room(packed, layout)
    record = np.dtype({
        "names": list(layout), "formats": [dtype for dtype, _ in layout.values()],
        "offsets": [offset for _, offset in layout.values()], "itemsize": packed.strides[1],
    })  # fmt: skip
    records = np.ndarray(packed.shape, record, packed.content.data, strides=packed.strides)
    columns = {role: records[role].reshape(-1) for role in layout}
    if packed.has_gaps:
        echo = np.isfinite(np.stack([columns[axis] for axis in "xyz"])).all(axis=0)
        columns = {role: column[echo] for role, column in columns.items()}
    if "time" in columns:
        columns["time"] = _seconds(columns["time"], stamp)
    return replace(cloud_of_columns(columns), stamp=seconds)


def _require_room(packed: _Packed, layout: dict[str, tuple[str, int]]) -> None:
    (rows, points), (row_step, point_step) = packed.shape, packed.strides
    ends = [offset + np.dtype(dtype).itemsize for dtype, offset in layout.values()]
    if max(ends) > point_step or point_step * points > row_step:
        raise InputError(
            f"its points of {point_step:,} bytes, {points:,} in rows of {row_step:,}, do not hold its fields"
        )
    if (needed := row_step * (rows - 1) + point_step * points) > len(packed.content):
        raise InputError(
            f"its {rows:,} x {points:,} points take {needed:,} bytes, and it holds {len(packed.content):,}"
        )


def _seconds(times: np.ndarray, stamp: int) -> np.ndarray:
    """Times (N,) float64 [s, UTC]; drivers count nanoseconds or seconds, since 1970 or since the message's stamp. Small
    integers may count milliseconds or microseconds, and are left as they are."""
    seconds = times.astype(np.float64)
    largest = np.abs(seconds[np.isfinite(seconds)]).max(initial=0)
    if largest > (_SINCE_THE_STAMP if times.dtype.kind in "iu" else _LARGEST_SECONDS):
        seconds, largest = seconds * _SECONDS_PER_COUNT, largest * _SECONDS_PER_COUNT
    return seconds + stamp / 10**9 if largest < _SINCE_THE_STAMP else seconds


def _moved(cloud: Cloud, content: Any) -> Cloud:
    """The cloud transformed by the pose that a foxglove.PointCloud has in its frame."""
    numbers = np.array(numbers_of(content.pose.position, content.pose.orientation))
    rotation = Rotation.from_quat(numbers[3:]) if numbers[3:].any() else Rotation.identity()
    return moved(cloud, RigidTransform.from_components(numbers[:3], rotation))


def moved(cloud: Cloud, T_target_cloud: RigidTransform) -> Cloud:
    """The cloud in another frame, with viewpoints unless the sensor is at that frame's origin."""
    if np.array_equal(T_target_cloud.as_matrix(), np.eye(4)):
        return cloud
    points = T_target_cloud.apply(cloud.points.astype(np.float64))
    seen_from = np.zeros_like(points) if cloud.viewpoints is None else cloud.viewpoints.astype(np.float64)
    viewpoints = T_target_cloud.apply(seen_from)
    return replace(cloud, points=points, viewpoints=viewpoints if viewpoints.any() else None)
