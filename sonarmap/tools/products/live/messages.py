"""Messages from the mapping to the page: points, poses, coverage and the state of the dive.

Each message has a name and replaces the previous one of that name. Texts are JSON, bytes little-endian numbers.
"""

import json
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from io import BytesIO
from struct import pack
from threading import Lock
from typing import Literal

import numpy as np
from PIL import Image
from scipy import ndimage
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.counted import counted
from sonarmap.slam.graph.tangent import worst_sigmas
from sonarmap.slam.live.growing import Pose
from sonarmap.tools.files.finding import Remedy

Message = tuple[str, str | bytes]  # name and content
CLOUD, LAST = 1, 2  # first byte of points: of a key scan, of the last scan
HEADER = 12  # bytes before the coordinates
RESET: Message = ("reset", '{"kind":"reset"}')  # the mapping was restarted: forget all messages
BLOCK = 64  # key scans whose poses are sent together
_QUANTUM = 0.001  # resolution of coordinates [m], coarser if a point is too far for it
_FARTHEST = 32767  # largest coordinate [quanta]
Status = Literal["waiting", "recording", "placed", "uncertain", "lost", "ended"]
_SILENT, _LATE = 3.0, 1.0  # silence and delay of the mapping that the sentence mentions [s]
_MANY = 256  # largest number of scans that wait in memory
AT_ONCE = 16  # binary messages that are sent before new texts
_SEEN = (  # color and legend of the classes 1 to 4 of cells
    ("#0072b2", "4 times or more"),
    ("#56b4e9", "2 or 3 times"),
    ("#e69f00", "once"),
    ("#d55e00", "holes, never seen"),
)
_LEAST_HOLE = 4  # cells; smaller gaps lie between beams
_WIDE_HOLE = 1.4  # from the middle of a hole that is worth a visit to its rim [cells]
_MOST_ACROSS = 1000  # cells along an axis; beyond it they are made coarser
_STRAY = 0.001  # share of the cells at each side that are left out as stray


def seven(T: RigidTransform) -> list[float]:
    """x, y, z [m] and the quaternion x, y, z, w, rounded."""
    return [*T.translation.round(4).tolist(), *T.rotation.as_quat().round(7).tolist()]


def poses(first: int, poses: Sequence[Pose]) -> Iterator[Message]:
    """Poses of the key scans from `first` on, in whole blocks of `BLOCK`."""
    for begin in range(first - first % BLOCK, len(poses), BLOCK):
        rows = [
            [pose.part, round(float(worst_sigmas(pose.covariance)[1]), 4), *seven(pose.T_part_sensor)]
            for pose in poses[begin : begin + BLOCK]
        ]
        yield f"poses {begin}", _text(kind="poses", first=begin, poses=rows)


def loops(pairs: Sequence[tuple[int, int]]) -> Message:
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


@dataclass(frozen=True, slots=True)
class State:
    """State of the dive; poses and positions are in the frame of a part of the map."""

    status: Status = "waiting"
    scans: int = 0
    placed: int = 0
    keys: int = 0
    loops: int = 0
    parts: int = 0  # of the map, not joined by any registration
    alone: bool = False  # whether the vehicle is in another part than the largest
    behind: int = 0  # number of waiting scans
    late: float = 0.0  # time from the last placed scan to the last received one [s]
    missing: int = 0  # missing shots
    silent: float = 0.0  # time since the last scan came [s]
    lost_for: float | None = None  # [s]
    held: float | None = None  # time since the vehicle was first placed, or lost, without a break [s]
    sigma: float = 0.0  # standard deviation of the vehicle's position [m]; 0 if unknown
    part: int = 0  # the vehicle's part of the map
    own: int = 0  # number of the dive's first key scan; earlier ones are of a finished map
    stamp: float | None = None  # of the last placed scan [s]
    pose: list[float] | None = None  # of the vehicle at `stamp`: x, y, z [m] and the quaternion x, y, z, w
    half_axes: list[list[float]] | None = None  # three vectors of the one-sigma ellipsoid of its position [m]
    sure: tuple[int, list[float]] | None = None  # part and position at which the vehicle was last not lost [m]
    depth: float | None = None  # below the start [m]
    speed: float | None = None  # [m/s]
    heading: float | None = None  # clockwise from North, or from the first scan's direction [deg]
    north: bool = False  # whether North is known
    altitude: float | None = None  # over the bed [m]
    ahead: float | None = None  # distance to the nearest wall ahead [m]
    alerts: tuple[str, ...] = ()
    remedies: tuple[Remedy, ...] = ()  # of the alerts
    choices: tuple[str, ...] = ()  # buttons of the page that choose a remedy

    @property
    def sentence(self) -> str:
        """The state in words."""
        first = {
            "waiting": "Waiting for scans",
            "recording": "The recording goes on, and the mapping begins again",
            "placed": f"Placed to within {_length(self.sigma)}" if self.sigma else "Placed",
            "uncertain": f"Placed, but only to within {_length(self.sigma)}",
            "lost": f"Lost{'' if self.lost_for is None else f' for {self.lost_for:.0f} s'}: {self._where_to_go()}",
            "ended": "The dive has ended",
        }[self.status]
        rest = [f"{self.placed:,} of {self.scans:,} scans placed", counted(self.loops, "loop")]
        if self.parts > 1:
            rest.append(f"{self.parts} parts that are not joined yet")
        if self.missing:
            rest.append(f"{counted(self.missing, 'shot')} missing")
        if self.late > _LATE:
            behind = f"{_MANY} or more scans" if self.behind >= _MANY else counted(self.behind, "scan")
            rest.append(f"{behind} ({self.late:.0f} s) behind")
        if self.silent > _SILENT and self.status != "ended":
            rest.append(f"nothing has come for {self.silent:.0f} s")
        return f"{first}; {', '.join(rest)}." if self.scans or self.silent > _SILENT else f"{first}."

    @property
    def message(self) -> str:
        """The state in JSON."""
        return json.dumps({"kind": "state", "sentence": self.sentence, **asdict(self)}, allow_nan=False)

    def _where_to_go(self) -> str:
        if self.alone:
            return "mapping a separate part until a known place is seen again"
        return "no scan matches the map; return to the last confirmed position"


def _length(meters: float) -> str:
    return f"{100 * meters:.0f} cm" if meters < 1 else f"{meters:.1f} m"


class Kept:
    """The latest message of each name. Its methods may be called from any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._changes = 0
        self._latest: dict[str, tuple[int, str | bytes]] = {}  # name -> number of the change, and content

    def add(self, message: Message) -> None:
        """Keep a message, which replaces the one of its name; an equal message changes nothing."""
        name, content = message
        with self._lock:
            if message == RESET:
                self._latest.clear()
            elif self._latest.get(name, (0, None))[1] == content:
                return
            self._latest.pop(name, None)
            self._changes += 1
            self._latest[name] = self._changes, content

    def after(self, reached: dict[type, int]) -> list[str | bytes]:
        """The next messages for a browser, texts first; empty if it has them all. `reached` holds the number of the
        last change that it has of each type, str and bytes, and is updated."""
        with self._lock:
            new = [(at, content) for at, content in self._latest.values() if at > reached.get(type(content), 0)]
        texts = [change for change in new if isinstance(change[1], str)]
        sent = texts + [change for change in new if isinstance(change[1], bytes)][:AT_ONCE]
        reached.update({type(content): at for at, content in sent})
        return [content for _, content in sent]


def coverage(seen: Sequence[np.ndarray], cell: float, part: int) -> Message:
    """A picture of the number of key scans that saw each cell of a part's plan.

    Args:
        seen: points of each key scan of the part, (n, 2) [m, the part's frame].
        cell: edge of a cell [m].
        part: number of the part.
    """
    counts, corner, cell = _counted(seen, cell)
    inside = _holes(counts == 0)
    kinds = np.select([counts >= 4, counts >= 2, counts == 1, inside], [1, 2, 3, 4]).astype(np.uint8)
    image = Image.fromarray(kinds[::-1])  # y up
    image.putpalette(bytes(3) + b"".join(bytes.fromhex(color[1:]) for color, _ in _SEEN))
    file = BytesIO()
    image.save(file, "png", transparency=0)
    areas = np.bincount(kinds.ravel(), minlength=5)[1:] * cell**2
    legend = [[color, words, float(area)] for (color, words), area in zip(_SEEN, areas, strict=True)]
    content = {"kind": "coverage", "part": part, "corner": corner, "size": [cell * n for n in kinds.shape[::-1]]}
    content["holes"] = (np.array(corner) + cell * (_middles(inside) + 0.5)).tolist()
    picture = "data:image/png;base64," + b64encode(file.getvalue()).decode()
    return f"coverage {part}", json.dumps({**content, "legend": legend, "picture": picture}, allow_nan=False)


def _counted(seen: Sequence[np.ndarray], cell: float) -> tuple[np.ndarray, list[float], float]:
    """Key scans per cell (height, width), in rows of ascending y; the smallest x and y [m]; the edge of a cell [m]."""
    cells = np.concatenate([_cells(points, cell) for points in seen])
    if not len(cells):
        return np.zeros((1, 1), int), [0.0, 0.0], cell
    low, high = np.quantile(cells, [_STRAY, 1 - _STRAY], axis=0).astype(int)
    if (high - low).max() >= _MOST_ACROSS:
        return _counted(seen, 2 * cell)
    counts = np.zeros((high - low + 1)[::-1], int)
    x, y = (cells[((cells >= low) & (cells <= high)).all(axis=1)] - low).T
    np.add.at(counts, (y, x), 1)
    return counts, (low * cell).tolist(), cell


def _cells(points: np.ndarray, cell: float) -> np.ndarray:
    """(n, 2) int, cells in which a scan has more than one point, as a single one may be a stray echo."""
    cells, counts = np.unique(np.floor(points / cell).astype(int), axis=0, return_counts=True)
    return cells[counts > 1]


def _holes(empty: np.ndarray) -> np.ndarray:
    """Cells that were never seen, but are enclosed by seen ones."""
    inside = empty & ndimage.binary_fill_holes(~empty)
    labels = np.zeros(empty.shape, np.int32)
    ndimage.label(inside, output=labels)
    return inside & (np.bincount(labels.ravel())[labels] >= _LEAST_HOLE)


def _middles(holes: np.ndarray) -> np.ndarray:
    """(n, 2) column and row of the cell farthest inside each hole, of holes that are wide enough to fly to."""
    far = np.asarray(ndimage.distance_transform_edt(holes))
    labels, count = ndimage.label(holes)
    middles = np.array(ndimage.maximum_position(far, labels, np.arange(1, count + 1)), int).reshape(-1, 2)
    return middles[far[tuple(middles.T)] >= _WIDE_HOLE][:, ::-1]
