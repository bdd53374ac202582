# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""What fixes a pose graph's gauge: what ties its components to the world, and what is held where nothing does."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.known_pose import KnownPose, MeasuredPoses, blocks, held_pose, known_at, turn_information
from sonarmap.slam.graph.tangent import adjoint
from sonarmap.spectral.covariance_at_sensor import cross_matrices
from sonarmap.spectral.measured import twist
from sonarmap.spectral.scan import PosePrior

# How far a vehicle's roll and pitch usually are from 0, standard deviation [rad].
_LEVEL = float(np.deg2rad(15.0))
# What instruments may measure of a pose, in the order of `unmeasured`.
MEASURED = ("tilt_x", "tilt_y", "heading", "east", "north", "up")
# What leaves a turn open by more than this tells no turn [rad], however small a step it is.
_TURNED = 0.3
# A direction in which a component is less sure than this is open, and held [m; turns by what they move it].
_UNSURE = 1e3
# Shares of an open motion below this are rounding.
_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class OpenMotion:
    """In which motions of a whole component nothing holds it."""

    middle: RigidTransform  # T_world_middle, level, about which the motions are: the control points' mean
    axes: np.ndarray  # (6, k) orthonormal columns of (turn, shift) along the world's axes; k is 0 where all is held
    lever: float  # what a turn counts [m], as columns hold turns times it

    @property
    def names(self) -> np.ndarray:
        """(6,) bool: which of tilt, tilt, heading, East, North and Up are open (MEASURED)."""
        return np.linalg.norm(self.axes, axis=1) > _SHARE

    def at(self, T_world_pose: RigidTransform) -> np.ndarray:
        """(6, k) orthonormal columns of the body tangent of a pose that the open motions move it along."""
        units = np.repeat([self.lever, 1.0], 3)
        columns, _ = np.linalg.qr(adjoint(T_world_pose.inv() * self.middle) @ (self.axes / units[:, None]))
        return columns


@dataclass(frozen=True)  # without slots: what is worked out is kept
class Gauge:
    """What holds the poses of a graph where they are.

    Every connected component needs a tie to the world: its fixed poses or what is measured of its poses is that tie,
    and where it has neither, its first pose is held (`anchors`). What nobody measured of any of its poses is held
    there too.
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
        placed = [self._is_placed(part) for part in parts] if self.measured else []
        if sum(placed) < 2:
            return parts
        world = tuple(sorted(pose for part, known in zip(parts, placed, strict=True) if known for pose in part))
        return tuple(sorted([world, *(part for part, known in zip(parts, placed, strict=True) if not known)]))

    @cached_property
    def anchors(self) -> tuple[int, ...]:
        """The poses held where they are: the fixed, and the first of a component that nothing else holds."""
        held = {edge.i for edge in self.edges if edge.kind == "prior"}.union(self.fixed, self.measured)
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
        return members[0] not in self.unmeasured and set(self.anchors).isdisjoint(members)

    @property
    def unmeasured(self) -> dict[int, np.ndarray]:
        """By the first pose of each component that does not wholly lie in the world: (6,) bool what nobody measured."""
        return dict(self.unconstrained) | {pose: free.names for pose, free in self.open_motions if free.names.any()}

    @property
    def unconstrained(self) -> list[tuple[int, np.ndarray]]:
        """The first pose of each component whose priors do not tell all, and (6,) bool what they do not tell."""
        beside = {*self.anchors, *(point.scan for point in self.control)}
        measured = (members for members in self.components if not beside.intersection(members))
        free = [(m[0], unmeasured(m, self.priors)) for m in measured if not self.priors.keys().isdisjoint(m)]
        return [(pose, what) for pose, what in free if what.any()]

    @cached_property
    def open_motions(self) -> list[tuple[int, OpenMotion]]:
        """The first pose of each component that control points hold, and the motions that nothing holds it in."""
        free = [m for m in self.components if self.control and not set(self.anchors).intersection(m)]
        return [
            (m[0], open_motion(control, self._known_beside_control, m, self.T_world))
            for m in free
            if (control := control_of(self.control, m))
        ]

    @property
    def all_known(self) -> list[KnownPose]:
        """All that is known of single poses but the anchors': `known`, the priors, and what is held beside these."""
        measured = self.by_priors
        control = [point.known_pose(self.T_world[point.scan]) for point in self.control]
        return [*self.beside_priors, *control, *([] if measured is None else measured.known())]

    @property
    def by_priors(self) -> MeasuredPoses | None:
        """What instruments measured; None where nothing."""
        return MeasuredPoses.of(self.priors, self.T_world) if self.priors else None

    @property
    def beside_priors(self) -> list[KnownPose]:
        """What else is known, and what is held where neither tells."""
        T = self.T_world
        held = [_held_unmeasured(pose, free, T[pose]) for pose, free in self.unconstrained]
        held += [held_pose(pose, T[pose], free.at(T[pose])) for pose, free in self.open_motions if free.axes.size]
        return [*self.known, *self._levels, *held, *self._undetermined]

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers less free ones."""
        free = 6 * (len(self.T_world) - len(self.anchors)) - sum(int(free.sum()) for _, free in self.unconstrained)
        free -= sum(motion.axes.shape[1] for _, motion in self.open_motions)
        measured = 6 * len(self.edges) + 3 * len(self.control)
        measured += sum(int(np.isfinite(prior.sigmas).sum()) for prior in self.priors.values())
        return measured + sum(known.rank for known in (*self.known, *self._levels, *self._undetermined)) - free

    def _is_placed(self, part: tuple[int, ...]) -> bool:
        """Whether instruments tell all of where the poses lie that edges join."""
        if not self.priors.keys().isdisjoint(part) and not unmeasured(part, self.priors).any():
            return True
        if control := control_of(self.control, part):
            return not open_motion(control, self._known_beside_control, part, self.T_world).axes.size
        known = [known for known in self.known if known.pose in set(part)]
        return bool(known) and undetermined(part, known, self.T_world) is None

    @cached_property
    def _known_beside_control(self) -> list[KnownPose]:
        return [*self.known, *known_at(self.priors, self.T_world)]

    @property
    def _levels(self) -> list[KnownPose]:
        """That vehicles float about level, where no instrument measured attitudes and positions alone tell the tilt."""
        free = [members for members in self.components if self.priors and set(self.anchors).isdisjoint(members)]
        return [level for members in free if (level := _level(members, self.priors, self.T_world)) is not None]

    @property
    def _undetermined(self) -> list[KnownPose]:
        """What holds components of which `known` tells something, but not all, and nothing else does."""
        elsewhere, held = {*self.anchors, *self.priors, *(point.scan for point in self.control)}, list[KnownPose]()
        for members in self.components if self.known else ():
            inside = set(members)
            own = [each for each in self.known if each.pose in inside]
            if own and inside.isdisjoint(elsewhere) and (holding := undetermined(members, own, self.T_world)):
                held.append(holding)
        return held


def unmeasured(members: Sequence[int], priors: Mapping[int, PosePrior]) -> np.ndarray:
    """(6,) bool: which of tilt, tilt, heading, East, North and Up no instrument tells of any of a component's poses.

    Positions of two poses tell the heading, of three and their depths the tilt too.
    """
    known = [priors[k] for k in members if k in priors]
    positions, depths = sum(p.knows_position for p in known), sum(p.knows_depth for p in known)
    tilted = any(p.knows_attitude for p in known) or min(positions, depths) >= 3
    headed = any(p.knows_heading for p in known) or positions >= 2
    return np.array([not tilted, not tilted, not headed, not positions, not positions, not depths])


def control_of(control: Sequence[ControlPoint], members: Sequence[int]) -> list[ControlPoint]:
    """The points of a component's scans that hold it."""
    inside = set(members)
    return [point for point in control if point.holds and point.scan in inside]


def open_motion(
    control: Sequence[ControlPoint], known: Sequence[KnownPose], members: Sequence[int], T_world: RigidTransform
) -> OpenMotion:
    """What control points, and what else is known of poses, leave open of where a component lies.

    Args:
        control: of the component's poses; the motions are about their middle, or that of the poses where there is none.
        known: what else is known of poses; those not among the component's `members` do not count.
        T_world: of all poses, about where they are.
    """
    places: np.ndarray = T_world[list(members)].translation
    if control:
        places = T_world[[each.scan for each in control]].apply(np.stack([each.point for each in control]))
    middle = RigidTransform.from_translation(places.mean(axis=0))
    lever = max(float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())), 1.0)
    units, inside, total = np.repeat([lever, 1.0], 3), set(members), np.zeros((6, 6))
    # a motion of all poses about the middle, as that of each point and of each pose
    if control:
        moved = np.tile(np.eye(3, 6, 3), (len(places), 1, 1))
        moved[:, :, :3] = cross_matrices(places.mean(axis=0) - places) / lever
        weighed = moved / np.stack([each.sigmas for each in control])[:, :, None]
        total = np.einsum("nij,nik->jk", weighed, weighed)
    for each in known:
        if each.pose in inside:
            A = adjoint(T_world[each.pose].inv() * middle) / units
            total += A.T @ each.information @ A
    values, axes = np.linalg.eigh(total)
    sigmas = 1 / np.sqrt(np.maximum(values, 1e-30))
    turns = sigmas * np.linalg.norm(axes[:3], axis=0) / lever
    return OpenMotion(middle, axes[:, (sigmas > _UNSURE) | (turns > (_TURNED if control else np.inf))], lever)


def undetermined(members: Sequence[int], known: Sequence[KnownPose], T_world: RigidTransform) -> KnownPose | None:
    """What holds a component in directions in which nothing known of its poses does; None where there is none."""
    free, T_world_first = open_motion((), known, members, T_world), T_world[members[0]]
    return held_pose(members[0], T_world_first, free.at(T_world_first)) if free.axes.size else None


def _level(members: Sequence[int], priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> KnownPose | None:
    """A vehicle floats about level: what is known of a component whose tilt positions alone would tell.

    Over a few meters these may tell any tilt, and turn the map on its side. None where attitudes are measured, or where
    not even positions tell the tilt, which is held then.
    """
    known = [k for k in members if k in priors]
    if not known or any(priors[k].knows_attitude for k in known) or unmeasured(members, priors)[:2].any():
        return None
    upright = Rotation.from_euler("Z", twist(T_world_sensor[known[:1]].rotation)[:, None])
    information = turn_information(upright, np.array([[_LEVEL**-2, _LEVEL**-2, 0.0]]))[0]
    T = RigidTransform.from_components(T_world_sensor[known[0]].translation, upright[0])
    return KnownPose(known[0], T, blocks(information, np.zeros((3, 3))))


def _held_unmeasured(pose: int, free: np.ndarray, T_world_sensor: RigidTransform) -> KnownPose:
    """What holds one pose where it is along what is `free`, (6,) bool as `unmeasured` gives it."""
    R = T_world_sensor.rotation
    of_world = blocks(Rotation.from_euler("Z", twist(R)).as_matrix(), np.eye(3))[:, free]
    return held_pose(pose, T_world_sensor, blocks(R.as_matrix().T, R.as_matrix().T) @ of_world)
