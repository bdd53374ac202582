"""What fixes a pose graph's gauge: what ties its components to the world, and what is held where nothing does.

Whatever was measured of single poses says something of the six motions of a whole component. The information about
these, summed over its poses, has directions in which nothing is known: the gauge holds those alone, so that it pulls
against no measurement.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.known_pose import KnownPose, MeasuredPoses
from sonarmap.slam.graph.tangent import adjoint
from sonarmap.spectral.scan import PosePrior

# The motions of a component, in the order of `unmeasured`.
MEASURED = ("tilt_x", "tilt_y", "heading", "east", "north", "up")
# A motion whose standard deviation is above these is open: a turn and its tilt [rad], and [m; turns by what they move
# the poses]. Positions tell a tilt by how short they are: of a larger one a first-order deviation means little.
_OPEN_TURN, _OPEN_TILT, _OPEN = 0.3, 0.1, 1e3
# An open motion is held by this share of the standard deviation of the motion that is known best. Firmer, GTSAM takes
# what is known least for unknown: a pivot 4096 times below its neighbor.
_HELD = 0.1
# Shares of an open motion below this are rounding.
_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class OpenMotion:
    """In which motions of a whole component nothing measured holds it."""

    middle: RigidTransform  # T_world_middle, level, about which the motions are
    axes: np.ndarray  # (6, k) orthonormal columns of (turn, shift) along the world's axes; k is 0 where all is known
    lever: float  # what a turn counts [m], as columns hold turns times it
    sigma: float  # with which they are held [m]

    @property
    def names(self) -> np.ndarray:
        """(6,) bool: which of tilt, tilt, heading, East, North and Up are open (MEASURED)."""
        return np.linalg.norm(self.axes, axis=1) > _SHARE

    def held(self, pose: int, T_world_pose: RigidTransform) -> KnownPose:
        """What holds one pose where it is along the open motions."""
        units = np.repeat([self.lever, 1.0], 3)[:, None]
        columns, _ = np.linalg.qr(units * (adjoint(T_world_pose.inv() * self.middle) @ (self.axes / units)))
        root = units * columns / self.sigma
        return KnownPose(pose, T_world_pose, root @ root.T)


@dataclass(frozen=True)  # without slots: what is worked out is kept
class Gauge:
    """What holds the poses of a graph where they are.

    Every connected component needs a tie to the world: its fixed poses or what is measured of its poses is that tie,
    and where it has neither, its first pose is held (`anchors`). Motions that nothing measured are held there too.
    """

    T_world: RigidTransform  # N poses, about where they are
    # edges, fixed, known, control: as of the graph
    edges: tuple[Edge, ...]
    fixed: tuple[int, ...]
    priors: Mapping[int, PosePrior]  # what instruments measured, by pose
    known: tuple[KnownPose, ...]
    control: tuple[ControlPoint, ...]

    @cached_property
    def components(self) -> tuple[tuple[int, ...], ...]:
        """The sets of poses that share a frame, in the order of their first poses.

        They are those that edges join; what instruments place wholly in the world shares the world.
        """
        parts = components(len(self.T_world), self.edges)
        motions = [self._open_motion(part) for part in parts] if self.measured else []
        placed = [motion is not None and not motion.axes.size for motion in motions]
        if sum(placed) < 2:
            return parts
        world = tuple(sorted(pose for part, known in zip(parts, placed, strict=True) if known for pose in part))
        return tuple(sorted([world, *(part for part, known in zip(parts, placed, strict=True) if not known)]))

    @cached_property
    def anchors(self) -> tuple[int, ...]:
        """The poses held where they are: the fixed, and the first of a component that nothing else holds."""
        held = self._tied.union(self.measured)
        first = (members[0] for members in self.components if held.isdisjoint(members))
        return tuple(sorted({*self.fixed, *first}))

    @cached_property
    def measured(self) -> set[int]:
        """The poses of which something is measured."""
        return {*self.priors, *(known.pose for known in self.known), *(point.scan for point in self.control)}

    @property
    def in_world(self) -> list[int]:
        """Poses of which instruments tell all six numbers, each by itself."""
        complete = {pose for pose, prior in self.priors.items() if prior.is_complete}
        return sorted(complete.union(known.pose for known in self.known if known.rank == 6))

    def lies_in_world(self, members: Sequence[int]) -> bool:
        """Whether instruments or control points tell all of where one of the components lies."""
        return members[0] not in self.open_motions and set(self.anchors).isdisjoint(members)

    @property
    def unmeasured(self) -> dict[int, np.ndarray]:
        """By the first pose of each component that does not wholly lie in the world: (6,) bool what nobody measured."""
        return {pose: motion.names for pose, motion in self.open_motions.items()}

    @cached_property
    def open_motions(self) -> dict[int, OpenMotion]:
        """By the first pose of each component of which something is measured, but not all: what is not."""
        tied = self._tied if self.measured else set[int]()
        motions = {m[0]: self._open_motion(m) for m in self.components if self.measured and tied.isdisjoint(m)}
        return {pose: motion for pose, motion in motions.items() if motion is not None and motion.axes.size}

    @property
    def all_known(self) -> list[KnownPose]:
        """All that is known of single poses but the anchors': `known`, the priors, and what is held beside these."""
        measured = self.by_priors
        control = [point.known_pose(self.T_world[point.scan]) for point in self.control]
        return [*self.beside_priors, *control, *([] if measured is None else measured.known(self.T_world))]

    @property
    def by_priors(self) -> MeasuredPoses | None:
        """What instruments measured; None where nothing."""
        return MeasuredPoses.of(self.priors) if self.priors else None

    @property
    def beside_priors(self) -> list[KnownPose]:
        """What else is known, and what is held where nothing is known."""
        return [*self.known, *(motion.held(pose, self.T_world[pose]) for pose, motion in self.open_motions.items())]

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers less free ones."""
        free = 6 * (len(self.T_world) - len(self.anchors))
        free -= sum(motion.axes.shape[1] for motion in self.open_motions.values())
        measured = 6 * len(self.edges) + 3 * len(self.control) + sum(known.rank for known in self.known)
        return measured + sum(int(np.isfinite(prior.sigmas).sum()) for prior in self.priors.values()) - free

    @cached_property
    def _tied(self) -> set[int]:
        """The poses that are fixed, or have a prior of all six numbers among the edges."""
        return {edge.i for edge in self.edges if edge.kind == "prior"}.union(self.fixed)

    def _open_motion(self, members: Sequence[int]) -> OpenMotion | None:
        return self._information.open_motion(members)

    @cached_property
    def _information(self) -> "MotionInformation":
        return MotionInformation.of(self.T_world, self.priors, self.known, self.control)


@dataclass(frozen=True, slots=True)
class MotionInformation:
    """What was measured of N poses, as information about motions of all of them as one body."""

    T_world: RigidTransform  # N poses, about where they are
    about: RigidTransform  # T_world_about, level: the motions are a turn about it and a shift, along the world's axes
    of_poses: np.ndarray  # (N, 6, 6) by what was measured of each
    scans: np.ndarray  # (m,) int, of which poses places were measured
    places: np.ndarray  # (m, 3) there [m]

    @classmethod
    def of(
        cls,
        T_world: RigidTransform,
        priors: Mapping[int, PosePrior],
        known: Sequence[KnownPose] = (),
        control: Sequence[ControlPoint] = (),
    ) -> "MotionInformation":
        """Of what instruments measured, by pose; what else is known of poses; and control points."""
        about, count = RigidTransform.from_translation(T_world.translation.mean(axis=0)), len(T_world)
        of_poses, placed = np.zeros((count, 6, 6)), np.zeros(count, bool)
        if priors:
            measured = MeasuredPoses.of(priors)
            J = measured.jacobian(T_world[measured.poses], about.translation)
            of_poses[measured.poses] = np.einsum("nij,ni,nik->njk", J, measured.precisions, J)
            placed[measured.poses] = (measured.precisions[:, 3:] > 0).any(axis=1)
        for each in [*known, *(point.known_pose(T_world[point.scan]) for point in control)]:
            A = adjoint(T_world[each.pose].inv() * about)
            of_poses[each.pose] += A.T @ each.information @ A
        placed[[each.pose for each in known if each.information[3:, 3:].any()]] = True
        own, points = np.flatnonzero(placed), [T_world[each.scan].apply(each.point) for each in control]
        scans = np.concatenate([own, np.array([each.scan for each in control], np.intp)])
        return cls(T_world, about, of_poses, scans, np.vstack([T_world.translation[own], *points]))

    def open_motion(self, members: Sequence[int]) -> OpenMotion | None:
        """What is open of the motions of a component's poses; None where nothing was measured of them.

        They are about the middle of the places that were measured, or of the poses where none was.
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
        free = (sigmas > _OPEN) | (turns > _OPEN_TURN) | (tilts > _OPEN_TILT)
        return OpenMotion(middle, axes[:, free], lever, _HELD * float(sigmas.min()))
