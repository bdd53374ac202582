"""A dive along a floodgate of piers, panels and a floor, which are seen twice; the poses drift until a loop closes."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import LastSure, State, Vehicle

LENGTH, DEPTH, SPAN = 42.0, 8.0, 6.0  # of the gate, of the water, between piers [m]
RANGE, WIDE, HIGH = 11.0, 65.0, 35.0  # of the sonar [m], half its field [deg]
CELL = 0.5  # of the coverage [m]
DRIFT = np.array([1.8, 0.9, 0.3])  # at the end, without the loop [m]


def scene(count: int, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Points of the gate and their normals, (count, 3) each [m]."""
    rng = np.random.default_rng(seed)
    patches = [((0, 0, -DEPTH), (LENGTH, 9, 0), (0, 0, 1)), ((0, 0, -DEPTH), (LENGTH, 0, DEPTH), (0, 1, 0))]
    for x in np.arange(0, LENGTH + 0.1, SPAN):
        patches += [
            ((x - 0.5, 2.5, -DEPTH), (1, 0, DEPTH), (0, 1, 0)),
            ((x - 0.5, 0, -DEPTH), (0, 2.5, DEPTH), (-1, 0, 0)),
        ]
        patches += [((x + 0.5, 0, -DEPTH), (0, 2.5, DEPTH), (1, 0, 0))]
    areas = np.array([np.prod([side for side in size if side]) for _, size, _ in patches])
    which = rng.choice(len(patches), count, p=areas / areas.sum())
    corner, size, normal = (np.array([patch[k] for patch in patches], float)[which] for k in range(3))
    points = corner + rng.random((count, 3)) * size
    points[:, 2] += (normal[:, 2] > 0) * 0.4 * np.sin(points[:, 0] / 3) * np.cos(points[:, 1])
    return points + rng.normal(0, 0.02, points.shape), normal


@dataclass
class KnownDive:
    keys: int = 200
    per_scan: int = 2500
    between: int = 3  # scans from one key scan to the next
    messages: int = 0
    counts: np.ndarray = field(default_factory=lambda: np.zeros((22, 92), np.int64))

    def __post_init__(self) -> None:
        self.points, self.normals = scene(400_000)
        self.rng = np.random.default_rng(1)

    def true_pose(self, at: float) -> tuple[np.ndarray, Rotation]:
        """At a share of the dive: along the gate and back, lower and nearer."""
        there = 2 * at if at < 0.5 else 2 - 2 * at
        place = np.array([1 + 40 * there, 7.5 if at < 0.5 else 6.0, -2.5 if at < 0.5 else -5.0])
        return place, Rotation.from_euler("ZYX", [-90 + 25 * np.sin(30 * at), 12, 0], degrees=True)

    def pose(self, at: float, closed: bool = False) -> np.ndarray:
        """As estimated, (7,)."""
        place, turn = self.true_pose(at)
        if not closed:
            place, turn = place + at**2 * DRIFT, Rotation.from_euler("z", 4 * at**2, degrees=True) * turn
        return np.concatenate([place, turn.as_quat()])

    def scan(self, at: float, count: int) -> np.ndarray:
        """What the sonar sees, (n, 3) in its frame [m]."""
        place, turn = self.true_pose(at)
        facing = np.einsum("ij,ij->i", self.normals, place - self.points) > 0
        own = turn.inv().apply(self.points[facing] - place)
        far = np.linalg.norm(own, axis=1)
        bearing, elevation = np.degrees(np.arctan2(own[:, 1], own[:, 0])), np.degrees(np.arcsin(own[:, 2] / far))
        seen = np.flatnonzero((far < RANGE) & (np.abs(bearing) < WIDE) & (np.abs(elevation) < HIGH))
        return own[self.rng.choice(seen, min(count, len(seen)), replace=False)]

    def state(self, at: float, key: int, closed: bool = False, lost: float | None = None) -> str:
        """What is said of the dive at a share of it; `lost`: for how long [s]."""
        scans = self.between * (key + 1)
        sigma = 0.01 + (0 if closed else 0.25 * at**2) + (0 if lost is None else 0.4)
        sure = LastSure(0, self.pose(at, closed)[:3])
        ahead = self.pose(min(1, at + (0 if lost is None else 0.03)), closed)
        return messages.state_message(
            State(
                "lost" if lost is not None else "placed",
                "The last 9 scans match nothing of the map."
                if lost is not None
                else "The vehicle is placed in the map.",
                *(scans / 5, scans, scans - (9 if lost is not None else 1), key + 1, 44 if closed else 0, 1, 2),
                lost,
                Vehicle(key, ahead, np.diag([sigma**2, (0.6 * sigma) ** 2, (0.4 * sigma) ** 2])),
                *(0, -float(ahead[2]), 0.43, -3.2, sure),
                ("No navigation: the map drifts until it meets itself.",) if not closed else (),
            )
        )

    def until(self, end: int, start: int = 0) -> Iterator[str | bytes]:
        """The messages of key scans from `start` up to `end`."""
        for key in range(start, end):
            at = key / self.keys
            cloud = self.scan(at, self.per_scan)
            yield messages.poses_message(key, [0], self.pose(at)[None])
            yield messages.cloud_message(key, cloud)
            yield messages.track_message([key], np.zeros((1, 3)))
            yield messages.last_message(key, self.scan(at, 3000))
            self.see(at, cloud)
            yield self.coverage()
            yield self.state(at, key)

    def see(self, at: float, cloud: np.ndarray) -> None:
        place, turn = self.true_pose(at)
        cells = np.unique(np.floor((turn.apply(cloud) + place)[:, :2] / CELL).astype(int) + np.array([4, 2]), axis=0)
        inside = (cells >= 0).all(axis=1) & (cells < [92, 22]).all(axis=1)
        self.counts[cells[inside, 1], cells[inside, 0]] += 1

    def coverage(self) -> bytes:
        return messages.coverage_message(self.counts // 4, CELL, (-4 * CELL, -2 * CELL), 0)

    def closure(self) -> Iterator[str]:
        """A loop closed: all poses anew."""
        shares = np.arange(self.keys) / self.keys
        yield messages.poses_message(0, np.zeros(self.keys), [self.pose(at, True) for at in shares])
        pairs = [(k, self.keys - 1 - k) for k in range(2, self.keys // 2 - 10, max(1, self.keys // 70))]
        yield messages.loops_message(pairs)
        yield self.state(1 - 1 / self.keys, self.keys - 1, closed=True)
