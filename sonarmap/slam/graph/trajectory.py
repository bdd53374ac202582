"""Stamped poses."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge, components, spanning_tree


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Stamped poses of the sensor, one per scan.

    Attributes:
        stamps: (N,) float64 [s, UTC], in the order of the scans; a counter where there is no time. Two dives
            in one survey, or files named out of order, may step back in time.
        T_world_sensor: N poses, p_world = T_world_sensor p_sensor [m].
    """

    stamps: np.ndarray
    T_world_sensor: RigidTransform

    def __post_init__(self) -> None:
        T, stamps = self.T_world_sensor, self.stamps
        if not isinstance(T, RigidTransform) or T.single or len(T) == 0:
            raise InputError("a trajectory needs a stack of at least one pose; give RigidTransform of shape (N,)")
        if not isinstance(stamps, np.ndarray):
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

    def farthest_from(self, other: "Trajectory") -> float:
        """Largest distance [m] between poses of the same index, each relative to its trajectory's first pose."""
        ours, theirs = ((T[0].inv() * T).translation for T in (self.T_world_sensor, other.T_world_sensor))
        return float(np.linalg.norm(ours - theirs, axis=1).max())


def chain(edges: Sequence[Edge], stamps: np.ndarray) -> Trajectory:
    """Poses by composing edges outward from the first pose of every component.

    Loops are used only where consecutive edges leave poses apart (`spanning_tree`). A component starts at its first
    prior, or at the identity where it has none: components without priors share no frame.
    """
    priors = {edge.i: edge.registration.T_target_source for edge in reversed(edges) if edge.kind == "prior"}
    return Trajectory(stamps, RigidTransform.from_matrix(composed(len(stamps), edges, priors).T))


@dataclass(frozen=True, slots=True)
class Composed:
    """N poses composed along a spanning tree of their edges, outward from one root in every component."""

    tree: list[Edge]
    T: np.ndarray  # (N, 4, 4) float64, each in the frame of its component
    order: np.ndarray  # (N,) int, the poses in preorder: each pose is followed by its subtree
    before: np.ndarray  # (N,) int, the parent of each pose; a root is its own
    by: np.ndarray  # (N,) int, index in `tree` of the edge from the parent


def composed(count: int, edges: Sequence[Edge], known: Mapping[int, RigidTransform]) -> Composed:
    """`count` poses, with each component's first `known` pose as its root, or else its first pose at the identity."""
    tree = spanning_tree(count, edges)
    neighbors: dict[int, list[tuple[int, int, bool]]] = defaultdict(list)
    for n, edge in enumerate(tree):
        neighbors[edge.i].append((edge.j, n, True))
        neighbors[edge.j].append((edge.i, n, False))
    steps = RigidTransform.concatenate([e.registration.T_target_source for e in tree] or [RigidTransform.identity()])
    forward, back = steps.as_matrix(), steps.inv().as_matrix()
    T, before, by = np.tile(np.eye(4), (count, 1, 1)), np.arange(count), np.zeros(count, np.intp)
    order: list[int] = []
    for members in components(count, edges):
        first = next((pose for pose in members if pose in known), members[0])
        if first in known:
            T[first] = known[first].as_matrix()
        waiting = [first]
        while waiting:
            i = waiting.pop()
            order.append(i)
            for j, n, is_forward in neighbors[i]:
                if j != before[i]:
                    T[j] = T[i] @ (forward if is_forward else back)[n]
                    before[j], by[j] = i, n
                    waiting.append(j)
    return Composed(tree, T, np.array(order, np.intp), before, by)
