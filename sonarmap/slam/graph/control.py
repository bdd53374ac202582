# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Control points: places in scans whose coordinates in the world are known."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Literal, get_args

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.tangent import adjoint
from sonarmap.spectral.covariance import cross_matrices

Use = Literal["control", "check"]


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A point that somebody picked in a scan and surveyed in the world.

    Attributes:
        name: of the point; several scans may show it.
        scan: the index of the scan's pose.
        point: (3,) float64 in the sensor frame [m].
        known: (3,) float64 its surveyed coordinates East, North, Up [m].
        sigmas: (3,) float64 standard deviations of `known` and of the picking together, along these axes [m].
        use: "control" holds the map there; "check" is only compared with it.

    Raises:
        InputError: numbers that are not finite, sigmas that are not above 0, or an unknown use.
    """

    name: str
    scan: int
    point: np.ndarray
    known: np.ndarray
    sigmas: np.ndarray
    use: Use = "control"

    def __post_init__(self) -> None:
        given: tuple[Any, ...] = (self.point, self.known, self.sigmas)
        for array in given:
            numbers = isinstance(array, np.ndarray) and array.shape == (3,) and array.dtype.kind in "fiu"
            if not numbers or not np.isfinite(array).all():
                raise InputError(f"control point {self.name}: {array} is not an array of three finite numbers")
        if not isinstance(self.scan, Integral):
            raise InputError(f"control point {self.name} is of scan {self.scan!r}; wanted its index, a whole number")
        if not (self.sigmas > 0).all():
            raise InputError(
                f"control point {self.name} has the standard deviations {self.sigmas}; wanted them above 0"
            )
        if not isinstance(self.use, str) or self.use not in get_args(Use):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"control point {self.name} is for {self.use!r}; wanted {' or '.join(get_args(Use))}")

    @property
    def holds(self) -> bool:
        """Whether the map is held there."""
        return self.use == "control"

    def factor(self) -> gtsam.NonlinearFactor:
        """For GTSAM: T_world_scan point - known."""
        return gtsam.GPSFactorArm(
            self.scan, self.known, self.point, gtsam.noiseModel.Diagonal.Sigmas(np.array(self.sigmas))
        )

    def known_pose(self, T_world_scan: RigidTransform) -> KnownPose:
        """What it tells of its scan's pose, to first order about where that is.

        Args:
            T_world_scan: the pose.
        """
        J = jacobian(T_world_scan, self.point)
        residual = T_world_scan.apply(self.point) - self.known
        toward: np.ndarray = -np.asarray(np.linalg.lstsq(J, residual, rcond=None)[0], np.float64)
        weighed = J / self.sigmas[:, None]
        T_measured = T_world_scan * RigidTransform.from_exp_coords(toward)
        return KnownPose(self.scan, T_measured, weighed.T @ weighed)


@dataclass(frozen=True, slots=True)
class MeasuredControl:
    """A control or check point in a finished map.

    Attributes:
        point: as it was given.
        estimated: (3,) where the map has it, East, North, Up [m].
        in_world: whether instruments or control points tell all of where the part of the map lies that it is in.
        wrong: of a control point that all others contradict, and that was therefore left out, by how many standard
            deviations of its own and the map's together; NaN of any other.
    """

    point: ControlPoint
    estimated: np.ndarray
    in_world: bool
    wrong: float = float("nan")

    @property
    def left_out(self) -> bool:
        """Whether others contradict it."""
        return bool(np.isfinite(self.wrong))

    @property
    def residual(self) -> np.ndarray:
        """(3,) estimated - known: East, North, Up [m]."""
        return self.estimated - self.point.known

    @property
    def in_sigmas(self) -> float:
        """The residual's length in its own standard deviations."""
        return float(np.linalg.norm(self.residual / self.point.sigmas))


def jacobian(T_world_scan: RigidTransform, point: np.ndarray) -> np.ndarray:
    """(3, 6) of T Exp(xi) p by the body tangent xi, rotation first: R (-[p]x, I)."""
    return T_world_scan.rotation.as_matrix() @ np.hstack([-cross_matrices(point[None])[0], np.eye(3)])


# What leaves a turn open by more than this tells no turn [rad], however small a step it is.
_TURNED = 0.3
# A direction in which a component is less sure than this is open [m].
_UNSURE = 1e3
# Shares of an open motion below this are rounding.
_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class OpenMotion:
    """In which motions of a whole component nothing holds it.

    Attributes:
        middle: T_world_middle, level, about which the motions are: the control points' mean.
        axes: (6, k) orthonormal columns of (turn, shift) along the world's axes; k is 0 where all is held.
        lever: what a turn counts [m], as columns hold turns times it.
    """

    middle: RigidTransform
    axes: np.ndarray
    lever: float

    @property
    def names(self) -> np.ndarray:
        """(6,) bool: which of tilt, tilt, heading, East, North and Up are open (`slam.graph.measured_poses`)."""
        return np.linalg.norm(self.axes, axis=1) > _SHARE

    def at(self, T_world_pose: RigidTransform) -> np.ndarray:
        """(6, k) orthonormal columns of the body tangent of a pose that the open motions move it along."""
        units = np.repeat([self.lever, 1.0], 3)
        columns, _ = np.linalg.qr(adjoint(T_world_pose.inv() * self.middle) @ (self.axes / units[:, None]))
        return columns


def control_of(control: Sequence[ControlPoint], members: Sequence[int]) -> list[ControlPoint]:
    """The points of a component's scans that hold it."""
    inside = set(members)
    return [point for point in control if point.holds and point.scan in inside]


def open_motion(
    control: Sequence[ControlPoint], known: Sequence[KnownPose], members: Sequence[int], T_world: RigidTransform
) -> OpenMotion:
    """What control points, and what else is known of poses, leave open of where a component lies.

    Args:
        control: at least one, of the component's poses.
        known: what else is known of poses; those of others do not count.
        members: the component's poses.
        T_world: of all poses, about where they are.
    """
    scans = [each.scan for each in control]
    places: np.ndarray = T_world[scans].apply(np.stack([each.point for each in control]))
    middle = RigidTransform.from_translation(places.mean(axis=0))
    lever = max(float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())), 1.0)
    units = np.repeat([lever, 1.0], 3)
    # a motion of all poses about the middle, as that of each point and of each pose
    moved = np.tile(np.eye(3, 6, 3), (len(places), 1, 1))
    moved[:, :, :3] = cross_matrices(places.mean(axis=0) - places) / lever
    weighed = moved / np.stack([each.sigmas for each in control])[:, :, None]
    inside, total = set(members), np.einsum("nij,nik->jk", weighed, weighed)
    for each in known:
        if each.pose in inside:
            A = adjoint(T_world[each.pose].inv() * middle) / units
            total += A.T @ each.information @ A
    values, axes = np.linalg.eigh(total)
    sigmas = 1 / np.sqrt(np.maximum(values, 1e-30))
    turns = sigmas * np.linalg.norm(axes[:3], axis=0) / lever
    return OpenMotion(middle, axes[:, (sigmas > _UNSURE) | (turns > _TURNED)], lever)
