"""The overlap of two scans with a known true transform, and the search for two viewpoints in a scene with a wanted one:
few beams propose, all beams decide."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol, TypeVar

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.scenes.catalog import SceneKind
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes, Sensor, cast

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


TRIES = 400  # poses that are tried before a search is given up
PLACES = 8  # targets that are tried before a pair is given up
ABOVE = 200.0  # height at which the search for the ground starts in a scene of 256 m [m]
ASIDE = np.pi / 4  # largest angle between an inward view and the direction to the scene's middle [rad]

CLEARANCE = 1 / 20  # least range of a surface, in shares of the sensor's maximum range
HEIGHT = (0.1, 0.25)  # of a target above the ground, least and greatest, in shares of the sensor's maximum range
SEEN_LEAST = 0.25  # least share of the beams with an echo

# Largest distance along x, y and z of a source from a target with which it has no overlap, in shares of the sensor's
# maximum range, and largest turn of its view, in shares of the fan's width
FAR = (2 / 3, 2 / 3, 1 / 8)
FAR_TURN = 1.0

THIN = 8  # largest stride of the coarse search over the beams of a row and of a column
COARSE_BEAMS = 768  # least number of beams of the coarse search
DOUBT = 0.1  # largest difference between the overlap of the coarse points and that of all beams


class _HasPoints(Protocol):
    @property
    def points(self) -> np.ndarray: ...


Look = TypeVar("Look", bound=_HasPoints)
# T_world_frame of a scan, points (N, 3) [m] of a few of its beams in that frame, and a function that looks with all
Candidate = tuple[RigidTransform, np.ndarray, Callable[[], Look | None]]


@dataclass(frozen=True, slots=True)
class WantedOverlap:
    """Wanted overlap of two scans, and how it is measured."""

    least: float
    most: float
    radius: float  # within which points have a counterpart [m]
    doubt: float  # largest difference between the overlap of a few points and that of all
    thin: int  # stride over the target's points in the coarse test


def find_partner(
    points: np.ndarray, T_world_target: RigidTransform, candidates: Iterable[Candidate[Look]], wanted: WantedOverlap
) -> tuple[Look, float] | None:
    """The first candidate that has the wanted overlap with a target's points (N, 3) [m], and the overlap; or None.

    A candidate is rejected by its few points if they leave no doubt; otherwise all points decide.
    """
    tree, sample = KDTree(points), points[:: wanted.thin]
    for T_world_source, coarse, look in candidates:
        T_target_source = T_world_target.inv() * T_world_source
        there = share_near(tree, T_target_source.apply(coarse), wanted.radius)
        if there < wanted.least - wanted.doubt or (seen := look()) is None:
            continue
        back = share_near(KDTree(seen.points), T_target_source.inv().apply(sample), wanted.radius)
        if not wanted.least - wanted.doubt <= min(there, back) <= wanted.most + wanted.doubt:
            continue
        share = mutual_overlap(points, seen.points, T_target_source, wanted.radius)
        if wanted.least <= share <= wanted.most:
            return seen, share
    return None


@dataclass(frozen=True, slots=True)
class View:
    """A noise-free view from one pose."""

    T_world_sensor: RigidTransform
    echoes: Echoes  # of all beams
    points: np.ndarray  # (N, 3) float64 [m], sensor frame, of the beams with an echo


@dataclass(frozen=True)
class Observer:
    """A scene, and the sensor that looks at it."""

    world: Scene
    sensor: Sensor

    @cached_property
    def _directions(self) -> np.ndarray:
        return self.sensor.directions()

    @cached_property
    def stride(self) -> int:
        """The coarse search takes every `stride`-th beam of a row and of a column."""
        beams = self.sensor.rows * self.sensor.columns
        return int(np.clip(np.sqrt(beams / COARSE_BEAMS), 1, THIN))

    def view(self, pose: RigidTransform) -> View | None:
        """The view of all beams from T_world_sensor; None if it is in a solid, too close to one, or sees too little."""
        if not self.is_free(pose) or self.coarse_points(pose) is None:
            return None
        echoes = cast(self.world, self.sensor, pose)
        if not self._is_clear(echoes.ranges, SEEN_LEAST):
            return None
        seen = np.isfinite(echoes.ranges)
        return View(pose, echoes, self._directions[seen] * echoes.ranges[seen][:, None])

    def is_free(self, pose: RigidTransform) -> bool:
        """Whether the sensor is outside all solids and, if the scene bounds its sensors from above, within bounds."""
        place, kind = pose.translation, self.world.kind
        if np.isfinite(kind.highest[2]) and not ((place >= kind.lowest) & (place <= kind.highest)).all():
            return False
        return not self.world.is_solid(place[None, :])[0]

    def coarse_points(self, pose: RigidTransform) -> np.ndarray | None:
        """Points (K, 3) [m, sensor frame] of a few beams; None if they already rule the view out."""
        few = self._directions[:: self.stride, :: self.stride].reshape(-1, 3)
        origins = np.broadcast_to(pose.translation, few.shape)
        ranges, _ = self.world.intersect(origins, pose.rotation.apply(few))
        ranges[(ranges < self.sensor.min_range) | (ranges > self.sensor.max_range)] = np.inf
        if not self._is_clear(ranges, SEEN_LEAST - DOUBT):
            return None
        seen = np.isfinite(ranges)
        return few[seen] * ranges[seen][:, None]

    def _is_clear(self, ranges: np.ndarray, least: float) -> bool:
        """Whether no surface is too close and at least a share `least` of the beams has an echo."""
        enough = np.isfinite(ranges).mean() >= least
        return bool(enough and ranges.min() >= CLEARANCE * self.sensor.max_range)


def first_view(observer: Observer, max_tilt: float, rng: np.random.Generator) -> View:
    """Draw a view from a pose in the inner part of the scene, above the ground and with no surface close to it. Raises
    InputError: none of TRIES poses has one."""
    world, sensor = observer.world, observer.sensor
    kind = world.kind
    for _ in range(TRIES):
        above = np.array([*rng.uniform(kind.lowest[:2], kind.highest[:2]), min(ABOVE * kind.scale, kind.highest[2])])
        drop, _ = world.intersect(above[None, :], np.array([[0.0, 0.0, -1.0]]))
        place = above - (0, 0, drop[0] - rng.uniform(*HEIGHT) * sensor.max_range)
        place[2] = np.clip(place[2], kind.lowest[2], kind.highest[2])
        pose = RigidTransform.from_components(place, attitude(heading_at(place, kind, rng), max_tilt, rng))
        view = observer.view(pose)
        if view is not None:
            return view
    raise InputError(f"{world.name} has no clear place for the sensor {sensor.name}; take another scene or seed")


def draw_views(
    observers: tuple[Observer, Observer],
    overlaps: tuple[float, float],
    max_tilt: float,
    draw_source: Callable[[View], RigidTransform],
    rng: np.random.Generator,
) -> tuple[View, View, float]:
    """Draw the view of a target, tilted by up to `max_tilt` [rad], and that of a source with an overlap within
    `overlaps`, of the poses that `draw_source` draws for a target; and the overlap. Raises InputError: none for any of
    PLACES targets."""
    first, second = observers

    def candidates(target: View) -> Iterator[Candidate[View]]:
        for _ in range(TRIES):
            pose = draw_source(target)
            coarse = second.coarse_points(pose) if second.is_free(pose) else None
            if coarse is not None:
                yield pose, coarse, partial(second.view, pose)

    radius = OVERLAP_RADIUS * second.world.kind.scale
    wanted = WantedOverlap(*overlaps, radius, DOUBT, max(second.stride**2 - 1, 1))
    for _ in range(PLACES):
        target = first_view(first, max_tilt, rng)
        match = find_partner(target.points, target.T_world_sensor, candidates(target), wanted)
        if match is not None:
            return target, *match
    raise InputError(
        f"no two views of {first.world.name} have an overlap within {overlaps[0]:g} to {overlaps[1]:g}: "
        f"{PLACES} targets, {TRIES} sources tried for each; widen the range, or take another number or seed"
    )


def aside(
    observer: Observer, target: View, overlaps: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Draw a position (3,) [m, world] beside the target's, within the scene, and a turn of its view [rad].

    Both are larger for a smaller overlap.
    """
    far = 1 - rng.uniform(*overlaps)
    here, edge = target.T_world_sensor.translation, np.array(observer.world.kind.size) / 2
    while True:
        place = here + far * observer.sensor.max_range * rng.uniform(-1, 1, 3) * FAR
        if (np.abs(place[:2]) < edge).all():
            break
    return place, far * FAR_TURN * observer.sensor.horizontal * rng.uniform(-1, 1)


def attitude(yaw: float, max_tilt: float, rng: np.random.Generator) -> Rotation:
    """Draw R_world_sensor with a given heading and a random pitch and roll up to `max_tilt` [rad]."""
    pitch, roll = rng.uniform(-max_tilt, max_tilt, 2)
    return Rotation.from_euler("ZYX", (yaw, pitch, roll))


def heading_at(place: np.ndarray, kind: SceneKind, rng: np.random.Generator) -> float:
    """Draw a heading [rad] at a position (2,) or (3,): any, or roughly toward the middle of an inward scene."""
    heading = rng.uniform(-np.pi, np.pi)
    return np.arctan2(-place[1], -place[0]) + heading * ASIDE / np.pi if kind.inward else heading
