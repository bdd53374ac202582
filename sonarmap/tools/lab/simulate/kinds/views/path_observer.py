"""A sensor carried along a short path: what all of its looks show together, in the frame of the middle one."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.simulate.pairs.viewpoints import Observer, View

COARSE_LOOKS = 3  # that a coarse search takes: the first, a middle one and the last


@dataclass(frozen=True, slots=True)
class PathView(View):
    """What is seen along a path; `echoes` are those of the middle look, `points` are of all, thinned.

    Attributes:
        looks: from each pose of the path.
    """

    looks: tuple[View, ...]


@dataclass(frozen=True)
class PathObserver(Observer):
    """An observer whose pose is that of the middle of a path.

    Attributes:
        T_middle_look: (K,) poses of the looks.
        cell: of the grid that the points are thinned by [m].
    """

    T_middle_look: RigidTransform
    cell: float

    @cached_property
    def _still(self) -> Observer:
        """The same sensor, looking once."""
        return Observer(self.world, self.sensor)

    def view(self, pose: RigidTransform) -> PathView | None:
        """What all looks show; None where one of them would be in a solid, too close to one, or see too little."""
        looks = []
        for look_pose in self._look_poses(pose, len(self.T_middle_look)):
            look = self._still.view(look_pose)
            if look is None:
                return None
            looks.append(look)
        points = _merged(pose, [(look.T_world_sensor, look.points) for look in looks])
        return PathView(pose, looks[len(looks) // 2].echoes, points[thinned(points, self.cell)], tuple(looks))

    def is_free(self, pose: RigidTransform) -> bool:
        """Whether all looks are out of every solid and in the water."""
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
        """T_world_look of `count` looks, evenly over the path."""
        chosen = np.linspace(0, len(self.T_middle_look) - 1, count).round().astype(int)
        return [pose * self.T_middle_look[k] for k in chosen]


def _merged(pose: RigidTransform, parts: list[tuple[RigidTransform, np.ndarray]]) -> np.ndarray:
    """Points (N, 3) of looks, T_world_look and points each, in the frame of `pose`."""
    return np.concatenate([(pose.inv() * look).apply(points) for look, points in parts])


def thinned(points: np.ndarray, cell: float) -> np.ndarray:
    """Indices of the first of `points` (N, 3) in each cell of a grid that holds any, ascending."""
    return np.sort(np.unique(_cells(points, cell), return_index=True)[1])


def lonely(points: np.ndarray, cell: float) -> np.ndarray:
    """Which of `points` (N, 3) are alone in their cell of a grid, (N,) bool."""
    _, inverse, counts = np.unique(_cells(points, cell), return_inverse=True, return_counts=True)
    return counts[inverse] == 1


def _cells(points: np.ndarray, cell: float) -> np.ndarray:
    """A number (N,) for the cell of each point."""
    index = np.floor(points / cell).astype(np.int64)
    index -= index.min(axis=0)
    shape = index.max(axis=0) + 1
    return (index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2]
