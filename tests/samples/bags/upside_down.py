"""Bags as drivers of the Sonar 3D-15 write them, over a flat bed, along a wall and under a hull, with z up or down."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, ellipsoid, merge
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import SONAR_3D15, cast
from tests.samples.bags.messages import CLOUD, STAMP, cloud
from tests.samples.bags.writers import Record, write_ros2

COUNT, DEPTH = 8, 5.0
SENSOR = replace(SONAR_3D15, columns=128, rows=48)
FIELDS = tuple((name, "f4", 4 * k) for k, name in enumerate(("x", "y", "z", "intensity")))


def _rocks(seed: int, low: tuple[float, float, float], high: tuple[float, float, float]) -> list[Mesh]:
    """Boxes around a plane, most of them flat."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform(low, high, (60, 3))
    return [box(center, rng.uniform(0.3, 1.2, 3), Rotation.random(rng=rng)) for center in centers]


@cache
def scene(name: str) -> Scene:
    """A bed 3 m below the sonar, a wall 6 m ahead of it, or a hull 2 to 4 m above it."""
    if name == "bed":
        mesh = merge([box((0, 0, -9.0), (80, 80, 2.0)), *_rocks(1, (0, -10, -8), (30, 10, -8))])
    elif name == "wall":
        mesh = merge([box((7.0, 0, 0), (2.0, 80, 60)), *_rocks(2, (6, -12, -10), (6, 18, 0))])
    else:
        hull = ellipsoid((8, 0, 0), (30, 9, 2.5), rings=40)
        mesh = merge([hull, *_rocks(3, (0, -6, -2.2), (22, 6, -1.8))])
    return Scene(name, mesh)


def poses(moves: bool) -> RigidTransform:
    """T_world_sensor: level and at one depth, or with changing depth, heading and attitude."""
    k = np.arange(COUNT)
    x = np.column_stack([0.5 * k, 0.3 * k, -DEPTH - 0.15 * k * moves])
    angles = np.deg2rad(np.column_stack([2.0 * k, 3 * np.sin(k), 4 * np.cos(k)])) * moves
    return RigidTransform.from_components(x, Rotation.from_euler("ZYX", angles))


def bag(folder: Path, name: str, down: bool, moves: bool = False, frame: str = "sonar_frame") -> Path:
    """A ROS 2 bag, and priors.csv of attitude and depth (and of headings, if the vehicle moves) beside it."""
    records: list[Record] = []
    rows = ["stamp,roll_deg,pitch_deg,depth_m" + ",heading_deg" * moves]
    tilt = RigidTransform.from_rotation(
        Rotation.from_euler("Y", {"bed": 35.0, "hull": -35.0}.get(name, 0.0), degrees=True)
    )
    for k, T in enumerate(poses(moves)):
        noise = disturb(cast(scene(name), SENSOR, T * tilt), SENSOR, Noise(sigma2=0.0004), np.random.default_rng(k))
        points = tilt.apply(scan_of(noise, SENSOR).points.astype(float)) * ([1, -1, -1] if down else [1, 1, 1])
        table = np.column_stack([points, np.full(len(points), 9.0)]).astype(np.float32)
        records.append(("/sonar_point_cloud", CLOUD, STAMP + k, cloud(table, STAMP + k, frame, fields=FIELDS, step=16)))
        yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True)
        row = [STAMP + k, roll, -pitch, -T.translation[2], *([90 - yaw] if moves else [])]
        rows.append(",".join(f"{number:.4f}" for number in row))
    (folder / "priors.csv").write_text("\n".join(rows) + "\n")
    return write_ros2(folder / "dive", records)
