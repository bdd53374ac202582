"""A dive along a floodgate of piers, panels and a floor, which are seen twice; the poses drift until a loop closes."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.coverage import coverage
from sonarmap.tools.products.live.messages import Message
from sonarmap.tools.products.live.state import State

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
    seen: list[np.ndarray] = field(default_factory=list[np.ndarray])  # in the plan

    def __post_init__(self) -> None:
        self.points, self.normals = scene(400_000)
        self.rng = np.random.default_rng(1)

    def true_pose(self, at: float) -> tuple[np.ndarray, Rotation]:
        """At a share of the dive: along the gate and back, lower and nearer."""
        there = 2 * at if at < 0.5 else 2 - 2 * at
        place = np.array([1 + 40 * there, 7.5 if at < 0.5 else 6.0, -2.5 if at < 0.5 else -5.0])
        return place, Rotation.from_euler("ZYX", [-90 + 25 * np.sin(30 * at), 12, 0], degrees=True)

    def pose(self, at: float, closed: bool = False) -> RigidTransform:
        """As estimated."""
        place, turn = self.true_pose(at)
        if not closed:
            place, turn = place + at**2 * DRIFT, Rotation.from_euler("z", 4 * at**2, degrees=True) * turn
        return RigidTransform.from_components(place, turn)

    def scan(self, at: float, count: int) -> np.ndarray:
        """What the sonar sees, (n, 3) in its frame [m]."""
        place, turn = self.true_pose(at)
        facing = np.einsum("ij,ij->i", self.normals, place - self.points) > 0
        own = turn.inv().apply(self.points[facing] - place)
        far = np.linalg.norm(own, axis=1)
        bearing, elevation = np.degrees(np.arctan2(own[:, 1], own[:, 0])), np.degrees(np.arcsin(own[:, 2] / far))
        seen = np.flatnonzero((far < RANGE) & (np.abs(bearing) < WIDE) & (np.abs(elevation) < HIGH))
        return own[self.rng.choice(seen, min(count, len(seen)), replace=False)]

    def state(self, at: float, key: int, closed: bool = False, lost: float | None = None) -> Message:
        """What is said of the dive at a share of it; `lost`: for how long [s]."""
        scans = self.between * (key + 1)
        sigma = 0.01 + (0 if closed else 0.25 * at**2) + (0 if lost is None else 0.4)
        ahead = self.pose(min(1, at + (0 if lost is None else 0.03)), closed)
        state = State(
            "placed" if lost is None else "lost",
            scans,
            scans - (1 if lost is None else 9),
            key + 1,
            44 if closed else 0,
            1,
            lost_for=lost,
            sigma=sigma,
            pose=messages.seven(ahead),
            half_axes=np.diag([sigma, 0.6 * sigma, 0.4 * sigma]).tolist(),
            sure=(0, self.pose(at, closed).translation.tolist()),
            depth=-float(ahead.translation[2]),
            speed=0.43,
            turn_rate=-3.2,
            alerts=() if closed else ("No navigation: the map drifts until it meets itself.",),
        )
        return "state", state.message

    def until(self, end: int) -> Iterator[Message]:
        """The messages of key scans up to `end`."""
        for key in range(end):
            at = key / self.keys
            points = self.scan(at, self.per_scan)
            poses = [self.pose(k / self.keys) for k in range(key + 1)]
            yield from messages.poses(key, [0] * (key + 1), poses)
            yield messages.cloud(key, points)
            yield messages.last(key, self.scan(at, 3000))
            place, turn = self.true_pose(at)
            self.seen.append((turn.apply(points) + place)[:, :2])
            yield coverage(self.seen, CELL, 0)
            yield self.state(at, key)

    def closure(self) -> Iterator[Message]:
        """A loop closed: all poses anew."""
        shares = np.arange(self.keys) / self.keys
        yield from messages.poses(0, [0] * self.keys, [self.pose(at, True) for at in shares])
        pairs = [(k, self.keys - 1 - k) for k in range(2, self.keys // 2 - 10, max(1, self.keys // 70))]
        yield messages.loops(pairs)
        yield self.state(1 - 1 / self.keys, self.keys - 1, closed=True)
