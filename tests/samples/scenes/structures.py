"""Synthetic places for tests of the registration: points, and ways to move and compare them."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registrar, Registration
from sonarmap.spectral.scan import Scan


def structure(seed: int, count: int = 6000) -> np.ndarray:
    """Points (N, 3) float32 on walls, posts and a floor, different for each seed [m]; about 20 m across."""
    rng = np.random.default_rng(seed)
    parts = [np.column_stack([rng.uniform(-9, 9, (count, 2)), rng.normal(-3, 0.05, count)])]
    for _ in range(7):
        corner, size = rng.uniform([-8, -8, -3], [5, 5, -1]), rng.uniform([0.1, 1, 1], [0.2, 5, 5])
        turn = Rotation.from_euler("Z", rng.uniform(0, np.pi))
        parts.append(turn.apply(rng.uniform(0, 1, (count // 6, 3)) * size) + corner)
    points = np.concatenate(parts)
    return points[np.abs(points).max(axis=1) < 10].astype(np.float32)


TURN = RigidTransform.from_components([1.5, -2.0, 0.75], Rotation.from_euler("ZYX", [25.0, -4.0, 7.0], degrees=True))


def moved(points: np.ndarray, T: RigidTransform) -> np.ndarray:
    """The points under T, float32."""
    return T.apply(points.astype(np.float64)).astype(np.float32)


def difference(a: RigidTransform, b: RigidTransform) -> tuple[float, float]:
    """Rotation [deg] and translation [m] between two transforms."""
    between = a.inv() * b
    return float(np.rad2deg(between.rotation.magnitude())), float(np.linalg.norm(between.translation))


def assert_near(found: RigidTransform, truth: RigidTransform, degrees: float, meters: float) -> None:
    angle, distance = difference(found, truth)
    assert angle < degrees
    assert distance < meters


def registered(registrar: Registrar, target: np.ndarray, source: np.ndarray) -> Registration:
    """The registration of two sets of points."""
    return registrar.register(*(registrar.prepare(Scan(points.astype(np.float32))) for points in (target, source)))
