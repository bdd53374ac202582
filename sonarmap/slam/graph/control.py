"""Control points: points in scans whose coordinates in the world are known."""

from dataclasses import dataclass
from numbers import Integral
from typing import Any, Literal, get_args

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.spectral.geometry import cross_matrices

Use = Literal["control", "check"]


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A point that somebody picked in a scan and surveyed in the world.

    Attributes:
        name: the point's name, the same in all scans that show it.
        scan: the index of the scan's pose.
        point: (3,) float64 in the sensor frame [m].
        known: (3,) float64 surveyed coordinates East, North, Up [m].
        sigmas: (3,) float64 standard deviations of `known` and of the picking together, along these axes [m].
        use: "control" constrains the map; "check" is only compared with it.
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
            raise InputError(f"control point {self.name} names scan {self.scan!r}; wanted its index, a whole number")
        if not (self.sigmas > 0).all():
            raise InputError(
                f"control point {self.name} has the standard deviations {self.sigmas}; wanted them above 0"
            )
        if not isinstance(self.use, str) or self.use not in get_args(Use):
            raise InputError(f"control point {self.name} has the use {self.use!r}; wanted {' or '.join(get_args(Use))}")

    @property
    def holds(self) -> bool:
        return self.use == "control"

    def factor(self) -> gtsam.NonlinearFactor:
        """GTSAM factor with the residual T_world_scan point - known [m]."""
        return gtsam.GPSFactorArm(
            self.scan, self.known, self.point, gtsam.noiseModel.Diagonal.Sigmas(np.array(self.sigmas))
        )

    def known_pose(self, T_world_scan: RigidTransform) -> KnownPose:
        """The prior of its scan's pose that it amounts to, linearized at T_world_scan."""
        J = jacobian(T_world_scan, self.point)
        residual = T_world_scan.apply(self.point) - self.known
        xi: np.ndarray = -np.asarray(np.linalg.lstsq(J, residual, rcond=None)[0], np.float64)
        whitened = J / self.sigmas[:, None]
        T_measured = T_world_scan * RigidTransform.from_exp_coords(xi)
        return KnownPose(self.scan, T_measured, whitened.T @ whitened)


@dataclass(frozen=True, slots=True)
class MeasuredControl:
    """A control or check point in a finished map."""

    point: ControlPoint  # as it was given
    estimated: np.ndarray  # (3,) its coordinates in the map, East, North, Up [m]
    in_world: bool  # whether instruments or control points fix its component of the map in the world
    # residual of a control point that was left out as all others contradict it, in standard deviations of the point and
    # the map together; NaN for any other
    wrong: float = float("nan")

    @property
    def left_out(self) -> bool:
        """Whether it was left out because all others contradict it."""
        return bool(np.isfinite(self.wrong))

    @property
    def residual(self) -> np.ndarray:
        """(3,) estimated - known: East, North, Up [m]."""
        return self.estimated - self.point.known

    @property
    def in_sigmas(self) -> float:
        """Mahalanobis length of the residual under the point's `sigmas`."""
        return float(np.linalg.norm(self.residual / self.point.sigmas))


def jacobian(T_world_scan: RigidTransform, point: np.ndarray) -> np.ndarray:
    """(3, 6) derivative of T Exp(xi) p with respect to the body tangent xi, rotation first: R (-[p]x, I)."""
    return T_world_scan.rotation.as_matrix() @ np.hstack([-cross_matrices(point[None])[0], np.eye(3)])
