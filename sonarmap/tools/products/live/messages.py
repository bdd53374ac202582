# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""What the mapping says to the page: each message with a name, under which it replaces the one before. Texts are JSON,
bytes little-endian numbers."""

import json
from collections.abc import Iterator, Sequence
from struct import pack

import numpy as np
from scipy.spatial.transform import RigidTransform

Message = tuple[str, str | bytes]

CLOUD, LAST = 1, 2  # first byte of points
HEADER = 12  # bytes before the coordinates
RESET: Message = ("reset", '{"kind":"reset"}')  # mapping began anew: forget everything
BLOCK = 64  # key scans whose poses are sent together
_QUANTUM = 0.001  # of coordinates, unless a point is too far for it [m]
_FARTHEST = 32767  # quanta


def seven(T: RigidTransform) -> list[float]:
    """x, y, z [m] and the quaternion x, y, z, w, as the page takes them."""
    return [*T.translation.round(4).tolist(), *T.rotation.as_quat().round(7).tolist()]


def poses(first: int, parts: Sequence[int], T_part_sensor: Sequence[RigidTransform]) -> Iterator[Message]:
    """Of all key scans, those from `first` on in blocks that have changed."""
    for begin in range(first - first % BLOCK, len(parts), BLOCK):
        block = zip(parts[begin : begin + BLOCK], T_part_sensor[begin : begin + BLOCK], strict=True)
        yield f"poses {begin}", _text(kind="poses", first=begin, poses=[[part, *seven(T)] for part, T in block])


def loops(pairs: Sequence[tuple[int, int]]) -> Message:
    """All loops that are kept, as numbers of key scans."""
    return "loops", _text(kind="loops", pairs=pairs)


def cloud(key: int, points: np.ndarray) -> Message:
    """The points of a key scan, (n, 3) [m] in its sensor frame."""
    return f"cloud {key}", _points(CLOUD, key, points)


def last(key: int, points: np.ndarray) -> Message:
    """The points of the last scan, (n, 3) [m] in the sensor frame of key scan `key`."""
    return "last", _points(LAST, key, points)


def _points(kind: int, key: int, points: np.ndarray) -> bytes:
    quantum = max(_QUANTUM, float(np.abs(points).max(initial=0.0)) / _FARTHEST)
    return pack("<B3xIf", kind, key, quantum) + np.rint(points / quantum).astype("<i2").tobytes()


def _text(**content: object) -> str:
    return json.dumps(content, allow_nan=False, separators=(",", ":"))
