"""Overlap of two scans with a known true transform."""

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor, cast

OVERLAP_RADIUS = 2.0  # [m]
HIDDEN = 1e-3  # a surface nearer than a point by this share of the sensor's range hides it
ROUNDING = 1e-9  # tolerance of a direction [rad], so that the outermost beams are in view


def overlap(
    target: np.ndarray, source: np.ndarray, T_target_source: RigidTransform, radius: float = OVERLAP_RADIUS
) -> float:
    """The share of the source's points (N, 3) that have a point of the target (M, 3) within `radius` [m], 0..1."""
    return share_near(KDTree(target), T_target_source.apply(source), radius)


def share_near(tree: KDTree, points: np.ndarray, radius: float) -> float:
    """The share of `points` (N, 3) that have a neighbor within `radius` [m]."""
    distance, _ = tree.query(points, distance_upper_bound=radius)
    return float(np.isfinite(distance).mean())


def mutual_overlap(
    target: np.ndarray, source: np.ndarray, T_target_source: RigidTransform, radius: float = OVERLAP_RADIUS
) -> float:
    """The smaller overlap of both directions, as in Registration.overlap."""
    return min(overlap(target, source, T_target_source, radius), overlap(source, target, T_target_source.inv(), radius))


def shared_view(scene: Scene, sensor: Sensor, T_world_target: RigidTransform, T_world_source: RigidTransform) -> float:
    """The share of one scan's points that are in the other's view, the smaller of both directions, 0..1.

    A point is in view if it is in the fan and in range and nothing hides it. Far points, which may lie farther apart
    than any radius, count as much as near ones: unlike `mutual_overlap` this does not depend on the density of the
    beams. It needs the scene and ignores noise.
    """
    target, source = (visible_points(scene, sensor, pose) for pose in (T_world_target, T_world_source))
    if not len(target) or not len(source):
        return 0.0
    there, back = in_view(scene, sensor, T_world_target, source), in_view(scene, sensor, T_world_source, target)
    return float(min(there.mean(), back.mean()))


def visible_points(scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform) -> np.ndarray:
    """Points (N, 3) [m, world] of a noise-free scan from a pose."""
    echoes = cast(scene, sensor, T_world_sensor)
    kept = np.isfinite(echoes.ranges) & (echoes.strengths >= sensor.threshold)
    return T_world_sensor.apply(sensor.directions()[kept] * echoes.ranges[kept][:, None])


def in_view(scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform, points: np.ndarray) -> np.ndarray:
    """Whether points (N, 3) [m, world] on surfaces are in the sensor's fan and range and nothing hides them; (N,)."""
    seen = T_world_sensor.inv().apply(points)
    ranges = np.linalg.norm(seen, axis=1)
    directions = (points - T_world_sensor.translation) / ranges[:, None]
    met, _ = scene.intersect(np.broadcast_to(T_world_sensor.translation, points.shape), directions)
    level = Rotation.from_euler("y", -sensor.tilt).apply(seen)
    azimuth, elevation = np.arctan2(level[:, 1], level[:, 0]), np.arcsin(level[:, 2] / ranges)
    across = np.abs(azimuth) <= sensor.horizontal / 2 + ROUNDING
    upright = np.abs(elevation) <= sensor.vertical / 2 + ROUNDING
    reached = (ranges >= sensor.min_range) & (ranges <= sensor.max_range)
    return across & upright & reached & (met >= ranges - HIDDEN * sensor.max_range)
