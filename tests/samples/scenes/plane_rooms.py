"""Rooms of plane walls, what a sonar sees in them, and patches without a sonar."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.baselines.planes.fit import Patches, tangents

# Outward normals and distances from the middle [m]: a box of unequal sides with two slanted walls and a slanted roof
ROOM = (
    np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [2, 1, 0], [-1, 2, 0.5], [0, -1, 2]]
    ),
    np.array([22.0, 17.0, 13.0, 19.0, 6.0, 8.0, 21.0, 15.0, 10.0]),
)
# Two walls without ends
CORRIDOR = (np.array([[0, 1, 0.0], [0, -1, 0]]), np.array([6.0, 9.0]))
T_TARGET_SOURCE = RigidTransform.from_components([2.0, -3.5, 0.7], Rotation.from_euler("ZYX", [0.5, -0.12, 0.2]))
T_ROOM_TARGET = RigidTransform.from_components([-1.0, 2.0, -0.5], Rotation.from_euler("ZYX", [-0.3, 0.05, 0.1]))
FARTHEST = 60.0


def look(
    room: tuple[np.ndarray, np.ndarray],
    T_room_sensor: RigidTransform,
    seed: int,
    sigma2: float = 0.0,
    beams: int = 12000,
) -> Scan:
    """What a sensor that looks everywhere sees; the variance of a range r is sigma2 r / FARTHEST [m^2]."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(beams, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normal = room[0] / np.linalg.norm(room[0], axis=1, keepdims=True)
    ahead = T_room_sensor.rotation.apply(directions) @ normal.T
    left = room[1] - T_room_sensor.translation @ normal.T
    ranges = np.min(np.where(ahead > 1e-9, left / np.maximum(ahead, 1e-9), np.inf), axis=1)
    seen = ranges <= FARTHEST
    measured = ranges[seen] + rng.normal(size=seen.sum()) * np.sqrt(sigma2 * ranges[seen] / FARTHEST)
    return Scan((directions[seen] * measured[:, None]).astype(np.float32))


def look_twice(room: tuple[np.ndarray, np.ndarray], seed: int, sigma2: float = 0.0) -> tuple[Scan, Scan]:
    """Target and source, T_TARGET_SOURCE apart."""
    return (
        look(room, T_ROOM_TARGET, 2 * seed, sigma2),
        look(room, T_ROOM_TARGET * T_TARGET_SOURCE, 2 * seed + 1, sigma2),
    )


def patches(normal: np.ndarray, middle: np.ndarray, turn: float = 0.01, shift: float = 0.1) -> Patches:
    """Square patches through middles (K, 3) [m]; each errs by `turn` [rad] about its middle and by `shift` [m]."""
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    basis = tangents(normal)
    lever = np.tile(np.eye(3), (len(normal), 1, 1))
    lever[:, 2, :2] = np.einsum("kij,ki->kj", basis[:, :3, :2], middle)
    spread = basis @ lever * np.array([turn, turn, shift])
    extent = 9.0 * (np.eye(3) - normal[:, :, None] * normal[:, None, :])
    area = np.full(len(normal), 108.0)
    distance = np.einsum("ki,ki->k", normal, middle)
    return Patches(normal, distance, spread @ np.swapaxes(spread, 1, 2), middle, extent, area)


def seen_from(planes: Patches, T: RigidTransform) -> Patches:
    """The patches (their normals, distances and middles) moved by T, with covariances that follow."""
    return patches(T.rotation.apply(planes.normal), T.apply(planes.middle))


def disturbed(planes: Patches, rng: np.random.Generator) -> Patches:
    """The patches with normals and distances drawn from their covariances."""
    values, vectors = np.linalg.eigh(planes.covariance)
    draw = np.einsum("kij,kj->ki", vectors, np.sqrt(np.maximum(values, 0)) * rng.normal(size=values.shape))
    normal = planes.normal + draw[:, :3]
    length = np.linalg.norm(normal, axis=1)
    distance = planes.distance + draw[:, 3]
    fields = (planes.covariance, planes.middle, planes.spread, planes.area)
    return Patches(normal / length[:, None], distance, *fields)
