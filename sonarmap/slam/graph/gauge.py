"""The gauge of a pose graph: what fixes its components in the world, and what is held where no measurement does.

A measurement of a single pose informs about the six rigid motions of its whole component. Motions about which the sum
over all its poses has no information are unconstrained: the gauge holds those alone, so that it biases no measurement.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.known_pose import KnownPose, known_poses
from sonarmap.slam.graph.tangent import adjoint
from sonarmap.spectral.scan import PosePrior

# The rigid motions of a component, in the order of `unmeasured`.
MEASURED = ("tilt_x", "tilt_y", "heading", "east", "north", "up")
# Standard deviations above which a motion is unconstrained. Those of turns that only positions show are first-order
# ones and mean little if large; a measured turn may be as uncertain as it is.
_OPEN_TURN = 0.3  # [rad]
_OPEN_TILT = 0.1  # [rad]
_OPEN = 1e3  # [m], turns times the lever
# Standard deviation that holds an unconstrained motion, over that of the best-known one. With a smaller one GTSAM takes
# the least-known motion for undetermined: a pivot 4096 times below its neighbor.
_HELD_SHARE = 0.1
_MIN_SHARE = 0.1  # smaller components of a unit motion are rounding


@dataclass(frozen=True, slots=True)
class OpenMotion:
    """The unconstrained rigid motions of a component."""

    middle: RigidTransform  # T_world_middle, level, the center of the turns
    axes: np.ndarray  # (6, k) orthonormal columns (lever * turn, shift) along the world's axes; k may be 0
    lever: float  # length by which turns are multiplied in `axes` [m]
    sigma: float  # standard deviation that holds them [m]

    @property
    def names(self) -> np.ndarray:
        """(6,) bool: which of the motions MEASURED are unconstrained."""
        return np.linalg.norm(self.axes, axis=1) > _MIN_SHARE

    def held(self, pose: int, T_world_pose: RigidTransform) -> KnownPose:
        """The prior that holds one pose at T_world_pose along the unconstrained motions."""
        units = np.repeat([self.lever, 1.0], 3)[:, None]
        columns, _ = np.linalg.qr(units * (adjoint(T_world_pose.inv() * self.middle) @ (self.axes / units)))
        root = units * columns / self.sigma
        return KnownPose(pose, T_world_pose, root @ root.T)


@dataclass(frozen=True)  # without slots: properties are cached
class Gauge:
    """What fixes the poses of a graph in the world.

    Fixed poses or measurements of single poses fix a connected component. Without either its first pose is held
    (`anchors`). Motions that no measurement constrains are held at the first pose too.
    """

    T_world: RigidTransform  # N poses, the linearization point
    # edges, fixed, known, control: as of a `PoseGraph`
    edges: tuple[Edge, ...]
    fixed: tuple[int, ...]
    priors: Mapping[int, PosePrior]  # what instruments measured, by pose
    known: tuple[KnownPose, ...]
    control: tuple[ControlPoint, ...]

    @cached_property
    def components(self) -> tuple[tuple[int, ...], ...]:
        """Sets of poses that share a frame, in the order of their first poses.

        Edges join poses; all components that measurements fully place in the world are one.
        """
        parts = components(len(self.T_world), self.edges)
        motions = [self._information.open_motion(part) for part in parts] if self.measured else []
        placed = [motion is not None and not motion.axes.size for motion in motions]
        if sum(placed) < 2:
            return parts
        world = tuple(sorted(pose for part, known in zip(parts, placed, strict=True) if known for pose in part))
        return tuple(sorted([world, *(part for part, known in zip(parts, placed, strict=True) if not known)]))

    @cached_property
    def anchors(self) -> tuple[int, ...]:
        """Poses that are held: the fixed ones, and the first of each component that nothing else fixes."""
        held = self._tied.union(self.measured)
        first = (members[0] for members in self.components if held.isdisjoint(members))
        return tuple(sorted({*self.fixed, *first}))

    @cached_property
    def measured(self) -> set[int]:
        """Poses with an instrument's prior, a known pose or a control point."""
        return {*self.priors, *(known.pose for known in self.known), *(point.scan for point in self.control)}

    @property
    def in_world(self) -> list[int]:
        """Poses whose own measurements determine all six numbers, ascending."""
        complete = {pose for pose, prior in self.priors.items() if prior.is_complete}
        return sorted(complete.union(known.pose for known in self.known if known.rank == 6))

    def lies_in_world(self, members: Sequence[int]) -> bool:
        """Whether measurements fix all six motions of a component."""
        return members[0] not in self.open_motions and set(self.anchors).isdisjoint(members)

    @property
    def unmeasured(self) -> dict[int, np.ndarray]:
        """(6,) bool, which motions are unconstrained, by the first pose of each partly measured component."""
        return {pose: motion.names for pose, motion in self.open_motions.items()}

    @cached_property
    def open_motions(self) -> dict[int, OpenMotion]:
        """The unconstrained motions by the first pose of each partly measured component."""
        tied = self._tied if self.measured else set[int]()
        motions = {
            m[0]: self._information.open_motion(m) for m in self.components if self.measured and tied.isdisjoint(m)
        }
        return {pose: motion for pose, motion in motions.items() if motion is not None and motion.axes.size}

    @property
    def all_known(self) -> list[KnownPose]:
        """Priors of single poses, without the anchors': `known_poses`, and control points'."""
        return [*self.known_poses, *(point.known_pose(self.T_world[point.scan]) for point in self.control)]

    @property
    def known_poses(self) -> list[KnownPose]:
        """`known`, instruments' priors, and the priors that hold unconstrained motions."""
        held = (motion.held(pose, self.T_world[pose]) for pose, motion in self.open_motions.items())
        return [*self._measured_poses, *held]

    @cached_property
    def _measured_poses(self) -> list[KnownPose]:
        """`known`, and instruments' priors."""
        return [*self.known, *known_poses(self.priors, self.T_world)]

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers minus unknowns."""
        free = 6 * (len(self.T_world) - len(self.anchors))
        free -= sum(motion.axes.shape[1] for motion in self.open_motions.values())
        measured = 6 * len(self.edges) + 3 * len(self.control) + sum(known.rank for known in self.known)
        return measured + sum(int(np.isfinite(prior.sigmas).sum()) for prior in self.priors.values()) - free

    @cached_property
    def _tied(self) -> set[int]:
        """Poses that are fixed, or have a prior among the edges."""
        return {edge.i for edge in self.edges if edge.kind == "prior"}.union(self.fixed)

    @cached_property
    def _information(self) -> "MotionInformation":
        return MotionInformation.of(self.T_world, self._measured_poses, self.control)


@dataclass(frozen=True, slots=True)
class MotionInformation:
    """Information about rigid motions of N poses together, from all measurements of single poses."""

    T_world: RigidTransform  # N poses, the linearization point
    about: RigidTransform  # T_world_about, level: a motion is a turn about it and a shift, along the world's axes
    of_poses: np.ndarray  # (N, 6, 6) information from the measurements of each pose
    of_turns: np.ndarray  # (N, 3, 3) information about turns from measured rotations alone
    scans: np.ndarray  # (m,) int, the pose of each measured place
    places: np.ndarray  # (m, 3) positions of these places [m, world]

    @classmethod
    def of(
        cls, T_world: RigidTransform, known: Sequence[KnownPose], control: Sequence[ControlPoint] = ()
    ) -> "MotionInformation":
        """From known poses, those of instruments included, and control points."""
        about, count = RigidTransform.from_translation(T_world.translation.mean(axis=0)), len(T_world)
        of_poses, of_turns = np.zeros((count, 6, 6)), np.zeros((count, 3, 3))
        for each in (point.known_pose(T_world[point.scan]) for point in control):
            A = adjoint(T_world[each.pose].inv() * about)
            of_poses[each.pose] += A.T @ each.information @ A
        if known:
            poses, information = np.array([each.pose for each in known]), np.stack([each.information for each in known])
            # along the measured axes, which no error of the estimate tilts
            R = RigidTransform.concatenate([each.T_world_pose for each in known]).rotation
            A = adjoint(RigidTransform.from_components(T_world.translation[poses], R).inv() * about)
            np.add.at(of_poses, poses, A.swapaxes(1, 2) @ information @ A)
            turns = R.as_matrix()
            np.add.at(of_turns, poses, turns @ information[:, :3, :3] @ turns.swapaxes(1, 2))
        positioned = sorted({each.pose for each in known if each.information[3:, 3:].any()})
        scans = np.array([*positioned, *(each.scan for each in control)], np.intp)
        points = [T_world[each.scan].apply(each.point) for each in control]
        places = np.array([*T_world.translation[np.array(positioned, np.intp)], *points]).reshape(-1, 3)
        return cls(T_world, about, of_poses, of_turns, scans, places)

    def open_motion(self, members: Sequence[int]) -> OpenMotion | None:
        """The unconstrained motions of a component; None where nothing was measured of its poses.

        Their center is the mean of the measured places, or of the poses where no place was measured.
        """
        chosen = np.array(members)
        total = self.of_poses[chosen].sum(axis=0)
        if not total.any():
            return None
        places = self.places[np.isin(self.scans, chosen)]
        places = places if len(places) else self.T_world.translation[chosen]
        middle = RigidTransform.from_translation(places.mean(axis=0))
        lever = max(float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())), 1.0)
        A = adjoint(self.about.inv() * middle) / np.repeat([lever, 1.0], 3)
        values, axes = np.linalg.eigh(A.T @ total @ A)
        sigmas = 1 / np.sqrt(np.maximum(values, 1e-30))
        turns, tilts = (sigmas * np.linalg.norm(axes[:k], axis=0) / lever for k in (3, 2))
        of_turns = np.einsum("ak,ab,bk->k", axes[:3], self.of_turns[chosen].sum(axis=0), axes[:3])
        measured = of_turns > (axes[:3] ** 2).sum(axis=0) / np.pi**2
        free = (sigmas > _OPEN) | (~measured & ((turns > _OPEN_TURN) | (tilts > _OPEN_TILT)))
        return OpenMotion(middle, axes[:, free], lever, _HELD_SHARE * float(sigmas.min()))
