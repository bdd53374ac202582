# pyright: strict
"""What the mapping says to the page: JSON in texts, little-endian numbers in bytes.

Frames: a cloud is in the sensor's frame of its key scan, a pose in the frame of its part of the map.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from struct import pack
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

CLOUD, LAST, COVERAGE = 1, 2, 3  # first byte of a binary message
CLOUD_HEADER, COVERAGE_HEADER = 12, 28  # bytes before the numbers
POINT = 6  # bytes of a point
_QUANTUM = 0.001  # of coordinates, unless a point is too far for it [m]
_FARTHEST = 32767  # quanta
_MOST_CELLS = 250_000  # of a coverage
_MOST_SEEN = 255
_DIGITS, _TURN_DIGITS = 4, 7  # behind the point, of meters and of a quaternion
_LONGEST, _MOST_ALERTS = 400, 8  # characters of a text, texts in a state

Status = Literal["waiting", "placed", "uncertain", "lost", "ended"]


@dataclass(frozen=True, slots=True)
class Vehicle:
    """key: the key scan that it was placed against.
    pose: x, y, z [m] and the quaternion x, y, z, w of T_part_sensor; the sensor's x axis is forward.
    covariance: (3, 3) of its place, in the part's frame [m^2]."""

    key: int
    pose: ArrayLike
    covariance: ArrayLike


@dataclass(frozen=True, slots=True)
class LastSure:
    """Where the vehicle was when its place was last sure, in the frame of a part [m]."""

    part: int
    place: ArrayLike


@dataclass(frozen=True, slots=True)
class State:
    """How the mapping is doing.

    sentence: what the page says of it; stamp: of the last scan [s].
    scans, placed, keys, loops, parts: numbers so far; behind: scans that wait.
    lost_since: for how long the vehicle was lost [s]; depth [m], speed [m/s], turn_rate [deg/s]: as estimated.
    """

    status: Status
    sentence: str
    stamp: float | None = None
    scans: int = 0
    placed: int = 0
    keys: int = 0
    loops: int = 0
    parts: int = 0
    behind: int = 0
    lost_since: float | None = None
    vehicle: Vehicle | None = None
    part: int = 0
    depth: float | None = None
    speed: float | None = None
    turn_rate: float | None = None
    last_sure: LastSure | None = None
    alerts: Sequence[str] = ()


def state_message(state: State) -> str:
    """A state, with texts cut to their longest, and null for numbers that are not finite."""
    vehicle, sure = state.vehicle, state.last_sure
    numbers = ("stamp", "lost_since", "depth", "speed", "turn_rate")
    counts = ("scans", "placed", "keys", "loops", "parts", "behind", "part")
    return _text(
        kind="state",
        status=state.status,
        sentence=state.sentence[:_LONGEST],
        alerts=[alert[:_LONGEST] for alert in state.alerts[:_MOST_ALERTS]],
        vehicle=None
        if vehicle is None
        else {
            "key": int(vehicle.key),
            "pose": _pose_rows(np.asarray(vehicle.pose, np.float64)[None])[0],
            "covariance": _finite(vehicle.covariance, (3, 3)).tolist(),
        },
        last_sure=None if sure is None else {"part": int(sure.part), "place": _rounded(_finite(sure.place, (3,)))},
        **{name: int(getattr(state, name)) for name in counts},
        **{name: _number(getattr(state, name)) for name in numbers},
    )


def poses_message(first: int, parts: ArrayLike, poses: ArrayLike) -> str:
    """The poses of key scans from `first` on: parts (n,), and poses (n, 7) as of a `Vehicle`."""
    rows = _pose_rows(np.asarray(poses, np.float64))
    numbers = np.asarray(parts, np.int64).tolist()
    return _text(kind="poses", first=int(first), poses=[[part, *row] for part, row in zip(numbers, rows, strict=True)])


def track_message(keys: ArrayLike, places: ArrayLike) -> str:
    """Where the vehicle was since the last of these messages: places (n, 3) [m] in the frames of key scans (n,)."""
    rows = _rounded(_finite(places, (-1, 3)))
    numbers = np.asarray(keys, np.int64).tolist()
    return _text(kind="track", points=[[key, *row] for key, row in zip(numbers, rows, strict=True)])


def loops_message(pairs: ArrayLike) -> str:
    """All loops that are kept: pairs (n, 2) of key scans."""
    return _text(kind="loops", pairs=np.asarray(pairs, np.int64).reshape(-1, 2).tolist())


def reset_message() -> str:
    """Mapping began anew: forget everything."""
    return _text(kind="reset")


def cloud_message(key: int, points: ArrayLike) -> bytes:
    """The points of a key scan, (n, 3) [m] in its sensor frame; those that are not finite are left out."""
    return _points(CLOUD, key, points)


def last_message(key: int, points: ArrayLike) -> bytes:
    """The points of the last scan, (n, 3) [m] in the sensor frame of key scan `key`."""
    return _points(LAST, key, points)


def coverage_message(counts: ArrayLike, cell: float, corner: Sequence[float], part: int) -> bytes:
    """How often each cell of a part's plan was seen: counts (height, width), row by row from the smallest y upward.

    cell: edge of a cell [m]; corner: the smallest x and y [m]. A plan of too many cells is made coarser; a cell then
    counts as the one of its four that was seen most.
    """
    grid = np.clip(np.asarray(counts), 0, _MOST_SEEN).astype(np.uint8)
    if grid.ndim != 2 or not all(map(math.isfinite, (cell, *corner))) or cell <= 0:
        raise ValueError(f"`counts` {grid.shape}, `cell` {cell}, `corner` {corner}: wanted (height, width), m, (x, y)")
    while grid.size > _MOST_CELLS:
        grid = np.pad(grid, [(0, size % 2) for size in grid.shape])
        grid = grid.reshape(grid.shape[0] // 2, 2, grid.shape[1] // 2, 2).max(axis=(1, 3))
        cell *= 2
    height, width = grid.shape
    return pack("<B3xIIfffI", COVERAGE, width, height, cell, corner[0], corner[1], part) + grid.tobytes()


def _points(kind: int, key: int, points: ArrayLike) -> bytes:
    rows = np.asarray(points, np.float64).reshape(-1, 3)
    rows = rows[np.isfinite(rows).all(axis=1)]
    quantum = max(_QUANTUM, float(np.abs(rows).max(initial=0.0)) / _FARTHEST)
    return (
        pack("<B3xIf", kind, key, quantum) + np.rint(rows / quantum).clip(-_FARTHEST, _FARTHEST).astype("<i2").tobytes()
    )


def _pose_rows(poses: np.ndarray) -> list[list[float]]:
    rows = _finite(poses, (-1, 7))
    return [
        place + turn for place, turn in zip(_rounded(rows[:, :3]), _rounded(rows[:, 3:], _TURN_DIGITS), strict=True)
    ]


def _finite(values: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(values, np.float64).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError("a pose, a place or a covariance is not finite; leave it out")
    return array


def _rounded(values: np.ndarray, digits: int = _DIGITS) -> list[Any]:
    return np.round(values, digits).tolist()


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), _DIGITS)


def _text(**content: Any) -> str:
    return json.dumps(content, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
