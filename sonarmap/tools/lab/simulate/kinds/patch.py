"""Patches: several looks of a 3D sonar along a short path, merged by odometry with its errors.

A front end passes such patches to registration when single scans are too sparse: it places the looks by odometry, drops
stray points and keeps one point per cell. The errors of odometry are a random walk away from the middle look, whose
frame is the patch's.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.map.cell import cell_keys
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.kind import LARGE_AND_SMALL, Shot, ViewKind
from sonarmap.tools.lab.simulate.sensing.noise import measure, scan_of
from sonarmap.tools.lab.simulate.viewpoints import OVERLAP_RADIUS, Observer, View

COARSE_LOOKS = 3  # looks of the coarse search: the first, a middle one and the last


@dataclass(frozen=True, slots=True)
class PathView(View):
    """A view along a path: `echoes` of the middle look, and `points` of all looks, thinned."""

    looks: tuple[View, ...]  # one from each pose of the path


@dataclass(frozen=True)
class PathObserver(Observer):
    """An observer that looks along a path; its pose is that of the middle look."""

    T_middle_look: RigidTransform  # (K,) poses of the looks
    cell: float  # of the grid that the points are thinned by [m]

    @cached_property
    def _still(self) -> Observer:
        """An observer with the same sensor that looks once."""
        return Observer(self.world, self.sensor)

    def view(self, pose: RigidTransform) -> PathView | None:
        """The merged view of all looks; None if one of them is in a solid, too close to one, or sees too little."""
        looks = []
        for look_pose in self._look_poses(pose, len(self.T_middle_look)):
            look = self._still.view(look_pose)
            if look is None:
                return None
            looks.append(look)
        points = _merged(pose, [(look.T_world_sensor, look.points) for look in looks])
        return PathView(pose, looks[len(looks) // 2].echoes, points[thinned(points, self.cell)], tuple(looks))

    def is_free(self, pose: RigidTransform) -> bool:
        """Whether all looks are outside all solids and in the water."""
        return all(self._still.is_free(look) for look in self._look_poses(pose, len(self.T_middle_look)))

    def coarse_points(self, pose: RigidTransform) -> np.ndarray | None:
        """Points (K, 3) [m, frame of the middle] of a few beams of a few looks; None as in `view`."""
        parts = []
        for look in self._look_poses(pose, COARSE_LOOKS):
            points = self._still.coarse_points(look)
            if points is None:
                return None
            parts.append((look, points))
        points = _merged(pose, parts)
        return points[thinned(points, self.cell)]

    def _look_poses(self, pose: RigidTransform, count: int) -> list[RigidTransform]:
        """T_world_look of `count` looks, spread evenly over the path."""
        chosen = np.linspace(0, len(self.T_middle_look) - 1, count).round().astype(int)
        return [pose * self.T_middle_look[k] for k in chosen]


def _merged(pose: RigidTransform, parts: list[tuple[RigidTransform, np.ndarray]]) -> np.ndarray:
    """Points (N, 3) of looks, T_world_look and points each, in the frame of `pose`."""
    return np.concatenate([(pose.inv() * look).apply(points) for look, points in parts])


def thinned(points: np.ndarray, cell: float) -> np.ndarray:
    """Ascending indices of the first of `points` (N, 3) in each occupied cell of a grid."""
    return np.sort(np.unique(cell_keys(points, cell, np.zeros(3))[0], return_index=True)[1])


def lonely(points: np.ndarray, cell: float) -> np.ndarray:
    """Which of `points` (N, 3) are alone in their cell of a grid, (N,) bool."""
    keys, _ = cell_keys(points, cell, np.zeros(3))
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return counts[inverse] == 1


LOOKS = (4, 11)  # number of looks of a patch, the upper end excluded
STEP = (0.015, 0.04)  # distance between looks, in shares of the sensor's maximum range
BEND = np.deg2rad(30.0)  # largest turn of a path from one end to the other
CRAB = np.deg2rad(20.0)  # largest angle between the vehicle's heading and its course
ROCKING = np.deg2rad(1.5)  # standard deviation of a look's roll and pitch against the middle one's
BEAMS = 2  # stride over the beams of the sensor's rows and columns
CELL = OVERLAP_RADIUS / 3  # edge of the cells that keep one point each, in a scene of 256 m [m]
STRAY = 3.0  # edge of the cells in which a single point is a stray, in units of CELL
# Standard deviations of odometry's error at either end of a path against its middle
DRIFT, TURNED = 0.2, np.deg2rad(0.3)  # each coordinate in a scene of 256 m [m]; about each axis [rad]


def on_path(still: Observer, rng: np.random.Generator) -> PathObserver:
    """Draw a path, and carry the observer along it with fewer beams."""
    sensor, scale = still.sensor, still.world.kind.scale
    few = replace(sensor, columns=sensor.columns // BEAMS, rows=sensor.rows // BEAMS)
    path = draw_path(int(rng.integers(*LOOKS)), rng.uniform(*STEP) * sensor.max_range, rng)
    return PathObserver(still.world, few, path, CELL * scale)


def draw_path(count: int, step: float, rng: np.random.Generator) -> RigidTransform:
    """Draw T_middle_look of `count` looks every `step` [m] along an arc; the vehicle crabs and rocks."""
    bend, crab = rng.uniform(-BEND, BEND), rng.uniform(-CRAB, CRAB)
    look = np.arange(count) - count // 2
    turned = bend * look / count
    heading = crab + turned
    # the course from one look to the next is the one halfway between them
    between = crab + bend * (look[:-1] + look[1:]) / 2 / count
    places = np.concatenate([[(0, 0)], np.cumsum(step * np.column_stack([np.cos(between), np.sin(between)]), axis=0)])
    places -= places[count // 2]
    rocking = rng.normal(0.0, ROCKING, (count, 2))
    rocking[count // 2] = 0.0
    angles = np.column_stack([heading - crab, rocking])
    return RigidTransform.from_components(
        np.column_stack([places, np.zeros(count)]), Rotation.from_euler("ZYX", angles)
    )


def believed_path(T_middle_look: RigidTransform, scale: float, rng: np.random.Generator) -> RigidTransform:
    """The path by odometry: exact in the middle, drifting away from the truth toward either end."""
    count = len(T_middle_look)
    walk = np.cumsum(rng.standard_normal((count, 6)), axis=0)
    walk = (walk - walk[count // 2]) / np.sqrt(count / 2)
    turns = Rotation.from_rotvec(TURNED * walk[:, :3])
    shifts = T_middle_look.translation + DRIFT * scale * walk[:, 3:]
    return RigidTransform.from_components(shifts, T_middle_look.rotation * turns)


def merged_scan(shot: Shot) -> Scan:
    """The patch that a front end merges from all looks; patches of even numbers have viewpoints, by odometry."""
    observer, view = shot.observer, shot.view
    assert isinstance(observer, PathObserver)
    assert isinstance(view, PathView)  # a PathObserver's
    believed = believed_path(observer.T_middle_look, observer.world.kind.scale, shot.distortion)
    looks = []
    for look in view.looks:
        echoes = measure(observer.world, observer.sensor, look.T_world_sensor, look.echoes, shot.noise, shot.rng)
        looks.append(scan_of(echoes, observer.sensor, name=shot.name))
    points = np.concatenate([believed[k].apply(look.points) for k, look in enumerate(looks)])
    number = np.repeat(np.arange(len(looks)), [len(look.points) for look in looks])
    strength = np.concatenate([look.strength for look in looks if look.strength is not None])
    kept = np.flatnonzero(~lonely(points, STRAY * observer.cell))
    kept = kept[thinned(points[kept], observer.cell)]
    return Scan(
        points[kept].astype(np.float32),
        strength[kept],
        stamp=shot.stamp,
        name=shot.name,
        viewpoints=believed.translation[number[kept]].astype(np.float32) if shot.number % 2 == 0 else None,
    )


PATCH = ViewKind("patch", LARGE_AND_SMALL, merged_scan, on_path)
