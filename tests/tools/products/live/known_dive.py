"""A dive eastward over a bed with a key scan every meter, and its messages to the page."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.live.growing import Pose
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import Message, State, coverage

COVARIANCE = np.diag([0.0, 0.0, 0.0, 0.01, 0.0036, 0.0016])  # of each pose
BETWEEN = 3  # scans from one key scan to the next


@dataclass
class KnownDive:
    per_scan: int
    seen: list[np.ndarray] = field(default_factory=list[np.ndarray])  # (N, 2) [m]

    def pose(self, key: int) -> RigidTransform:
        return RigidTransform.from_components([float(key), 0.0, -3.0], Rotation.from_euler("z", 20, degrees=True))

    def state(self, key: int, lost: float | None = None) -> Message:
        """State message after a key scan; `lost`: time since the vehicle was lost [s]."""
        scans, pose = BETWEEN * (key + 1), self.pose(key)
        state = State(
            "placed" if lost is None else "lost",
            scans,
            scans - 1,
            key + 1,
            0,
            1,
            lost_for=lost,
            sigma=0.1,
            pose=messages.seven(pose),
            half_axes=np.diag([0.1, 0.06, 0.04]).tolist(),
            sure=(0, pose.translation.tolist()),
            depth=3.0,
            speed=0.43,
            held=lost or 192.0,
            heading=70.4,
            altitude=2.13,
            ahead=6.82,
        )
        return "state", state.message

    def until(self, end: int) -> Iterator[Message]:
        """Messages of the first `end` key scans."""
        rng = np.random.default_rng(1)
        for key in range(end):
            points = rng.uniform([1, -4, -5.2], [9, 4, -5], (self.per_scan, 3))
            yield from messages.poses(key, [Pose(0, self.pose(k), COVARIANCE) for k in range(key + 1)])
            yield messages.cloud(key, points)
            yield messages.last(key, points)
            self.seen.append(self.pose(key).apply(points)[:, :2])
            yield coverage(self.seen, 0.5, 0)
            yield self.state(key)
