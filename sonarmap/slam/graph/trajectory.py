# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""Stamped poses."""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge, components, spanning_tree


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Where the sensor was, scan by scan.

    Attributes:
        stamps: (N,) float64 [s, UTC], in the order of the scans; a counter where there is no time. Two dives
            in one survey, or files named out of order, may step back in time.
        T_world_sensor: N poses, p_world = T_world_sensor p_sensor [m].

    Raises:
        InputError: no pose, a single transform instead of a stack, another number of stamps, or a stamp that
            is not finite.
    """

    stamps: np.ndarray
    T_world_sensor: RigidTransform

    def __post_init__(self) -> None:
        T, stamps = self.T_world_sensor, self.stamps
        if not isinstance(T, RigidTransform) or T.single or len(T) == 0:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError("a trajectory needs a stack of at least one pose; give RigidTransform of shape (N,)")
        if not isinstance(stamps, np.ndarray):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"stamps are of type {type(stamps).__name__}; wanted an array of float64")
        if stamps.dtype != np.float64 or stamps.shape != (len(T),):
            raise InputError(
                f"stamps are {stamps.dtype} of shape {stamps.shape}; wanted float64 of shape ({len(T)},), one per pose"
            )
        if not np.isfinite(stamps).all():
            raise InputError(f"stamp {int(np.argmin(np.isfinite(stamps)))} is not finite; wanted seconds")
        if not np.isfinite(T.translation).all():
            raise InputError("a pose of the trajectory has a translation that is not finite; wanted meters")

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, indices: Sequence[int]) -> "Trajectory":
        """The poses of these indices, in their order."""
        chosen = np.asarray(indices, dtype=np.intp)
        return Trajectory(self.stamps[chosen], self.T_world_sensor[chosen])


def chain(edges: Sequence[Edge], stamps: np.ndarray) -> Trajectory:
    """Poses by composing edges outward from the first pose of every component.

    Consecutive edges are followed wherever they reach; loops only join what they leave apart. A component starts at
    its first prior, or at the identity where it has none: poses of two components without priors share no frame.

    Args:
        edges: measurements between poses 0..N-1.
        stamps: (N,) float64 [s], of the poses.
    """
    count = len(stamps)
    tree = spanning_tree(count, edges)
    neighbors: dict[int, list[tuple[int, np.ndarray]]] = defaultdict(list)
    if tree:
        T_i_j = RigidTransform.concatenate([edge.registration.T_target_source for edge in tree])
        for edge, forward, back in zip(tree, T_i_j.as_matrix(), T_i_j.inv().as_matrix(), strict=True):
            neighbors[edge.i].append((edge.j, forward))
            neighbors[edge.j].append((edge.i, back))
    priors = {edge.i: edge.registration.T_target_source for edge in reversed(edges) if edge.kind == "prior"}
    T_world, known = np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, bool)
    for members in components(count, edges):
        first = next((pose for pose in members if pose in priors), members[0])
        if first in priors:
            T_world[first] = priors[first].as_matrix()
        known[first] = True
        reached = deque([first])
        while reached:
            i = reached.popleft()
            for j, step in neighbors[i]:
                if not known[j]:
                    T_world[j] = T_world[i] @ step
                    known[j] = True
                    reached.append(j)
    return Trajectory(stamps, RigidTransform.from_matrix(T_world))
