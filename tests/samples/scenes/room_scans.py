"""What a sonar sees of a room with a pole in it, from poses within: walls, range noise and wild echoes."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan

HALF = np.array([12.0, 9.0, 5.0])  # of the room, about the origin [m]
POLE, RADIUS = np.array([2.0, -1.0]), 0.12  # x, y of its axis, from floor to ceiling [m]


def room_poses(count: int, seed: int = 0) -> RigidTransform:
    """Poses in the room's middle part, looking all around, a little tilted."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.6, 0.6, (count, 3)) * HALF
    places[:, 1] = np.where(np.abs(places[:, 1] - POLE[1]) < 1.5, places[:, 1] + 3.5, places[:, 1])
    turns = np.column_stack([np.linspace(0, 4 * np.pi, count), rng.normal(0, 0.05, (count, 2))])
    return RigidTransform.from_components(places, Rotation.from_euler("ZYX", turns))


def look(T: RigidTransform, rng: np.random.Generator, sigma: float = 0.02, wild: float = 0.0) -> Scan:
    """One scan of 120 x 90 beams over 110 x 80 degrees; `sigma` of the ranges [m], share of `wild` echoes."""
    azimuth, elevation = np.meshgrid(np.radians(np.linspace(-55, 55, 120)), np.radians(np.linspace(-40, 40, 90)))
    level = np.cos(elevation)
    beams = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    aim = T.rotation.apply(beams)
    true = np.min((np.where(aim > 0, HALF, -HALF) - T.translation) / aim, axis=1)
    true = np.minimum(true, _to_pole(T.translation[:2], aim[:, :2]))
    ranges = true + rng.normal(0, sigma, len(true))
    ranges = np.where(rng.random(len(true)) < wild, rng.uniform(0.5, 30, len(true)), ranges)
    return Scan((beams * ranges[:, None]).astype(np.float32), name="room")


def _to_pole(place: np.ndarray, aim: np.ndarray) -> np.ndarray:
    """(n,) distances to the pole along beams whose x, y are `aim` (n, 2); inf for beams that miss it."""
    away = place - POLE
    a, b, c = (aim**2).sum(axis=1), aim @ away, away @ away - RADIUS**2
    root = b**2 - a * c
    way = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (way > 0), way, np.inf)


def pole_distance(points: np.ndarray) -> np.ndarray:
    """(n,) from the pole's surface [m]."""
    return np.abs(np.linalg.norm(points[:, :2] - POLE, axis=1) - RADIUS)


def room_distance(points: np.ndarray) -> np.ndarray:
    """(n,) from the nearest surface, for points in the room; negative for those behind its walls [m]."""
    return np.minimum((HALF - np.abs(points)).min(axis=1), pole_distance(points))
