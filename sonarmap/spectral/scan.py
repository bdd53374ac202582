"""One scan: the points that a sensor saw from one pose."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError


@dataclass(frozen=True)
class PosePrior:
    """A scan's pose as measured by the vehicle's instruments, with the standard deviations of their errors.

    The errors are independent, each about its own axis:

    - rotation: R_true = Exp(w) R_measured with w in the world: `w = Rz(h) (roll, pitch, heading error)` [rad], where h
      is the twist of R_measured about the vertical (R_measured = Rz(h) S, S about a level axis). The roll error is
      thus about the sensor's x axis brought level by the shortest turn, the pitch error about its y axis brought level
      likewise, the heading error about the world's vertical. Near level these are the errors of roll, pitch and yaw;
      unlike those the three stay perpendicular however the sensor is tilted (but for upside down). Where `turned` is
      False, h is 0: the errors are about the world's axes.
    - translation: along the world's East, North and Up [m].

    This is not the tangent of a `Registration`'s covariance, which perturbs on the right, in the sensor's own frame.

    Attributes:
        T_world_sensor: the measured pose (world East-North-Up, sensor x forward, y left, z up); components that were
            not measured are ignored, so leave them 0.
        sigmas: (6,) float64 standard deviations, rotation first: roll, pitch, heading [rad], then East, North, Up [m];
            inf where not measured. Roll and pitch are measured both or neither, East and North likewise.
        turned: whether the errors of roll and pitch are about axes turned with the heading, as an instrument's are.

    Raises:
        InputError: a stack of poses, a pose that is not finite, or sigmas of another shape, NaN, not above 0, or of
            one of roll and pitch, or East and North, alone.
    """

    T_world_sensor: RigidTransform
    sigmas: np.ndarray
    turned: bool = True

    def __post_init__(self) -> None:
        T = self.T_world_sensor
        if not isinstance(T, RigidTransform) or not T.single or not np.isfinite(T.as_matrix()).all():
            raise InputError("`T_world_sensor` is not one finite pose; give what is not measured the value 0")
        sigmas = self.sigmas
        if not isinstance(sigmas, np.ndarray) or sigmas.shape != (6,) or sigmas.dtype != np.float64:
            raise InputError(
                f"`sigmas` are {sigmas!r}; wanted float64 of shape (6,): roll, pitch, heading [rad], "
                "East, North, Up [m]"
            )
        if not (sigmas > 0).all():  # NaN is refused too
            raise InputError(
                f"`sigmas` are {sigmas.tolist()}; wanted numbers above 0, and inf for what is not measured"
            )
        for first, names in ((0, "roll and pitch"), (3, "East and North")):
            if np.isfinite(sigmas[first]) != np.isfinite(sigmas[first + 1]):
                raise InputError(
                    f"`sigmas` know only one of {names} ({sigmas[first]:g} and {sigmas[first + 1]:g}); give both a "
                    "standard deviation, or both inf"
                )

    @cached_property
    def R_world_sensor(self) -> Rotation:
        """The rotation of the measured pose; SciPy checks its matrix each time that it is taken from the pose."""
        return self.T_world_sensor.rotation

    @property
    def knows_attitude(self) -> bool:
        """Whether roll and pitch are measured."""
        return bool(np.isfinite(self.sigmas[:2]).all())

    @property
    def knows_heading(self) -> bool:
        return bool(np.isfinite(self.sigmas[2]))

    @property
    def knows_position(self) -> bool:
        """Whether East and North are measured."""
        return bool(np.isfinite(self.sigmas[3:5]).all())

    @property
    def is_complete(self) -> bool:
        """Whether attitude, heading, depth and position are all measured."""
        return bool(np.isfinite(self.sigmas).all())

    @property
    def knows_depth(self) -> bool:
        """Whether the height, minus the depth, is measured."""
        return bool(np.isfinite(self.sigmas[5]))


def refuse_mask(array: Any, name: str) -> None:
    """Raise InputError for an array, or list of arrays, with masked values: the code that uses it ignores masks."""
    if np.ma.is_masked(array) or (type(array) in (list, tuple) and any(map(np.ma.is_masked, array))):
        raise InputError(
            f"{name}: the array is masked, and masks are not used; give the unmasked values alone, as in "
            "`points[~np.ma.getmaskarray(points).any(axis=1)].data`"
        )


@dataclass(frozen=True, slots=True)
class Scan:
    """Points in the frame of the sensor that saw them.

    Attributes:
        points: (N, 3) float32 [m], sensor frame (x forward, y left, z up), all finite, N >= 1.
        strength: (N,) float32, linear echo strength >= 0, all finite, or None if the sensor gives none.
        stamp: time of the scan [s, UTC]; a counter if the files carry no time.
        prior: the pose as measured by other instruments, or None.
        name: name of the scan in messages and tables.
        viewpoints: (N, 3) float32 [m], position of the sensor when it saw each point, in the frame of the points, all
            finite. None: the frame's origin for all points, or unknown for a patch merged from several views; which of
            the two is decided from the points.
        times: (N,) float32 [s] after the stamp at which each point was seen, all finite; the points are then in the
            sensor's frame at these times. None: all points are in the sensor's frame at the stamp.

    Raises:
        InputError: an array of another shape or dtype, masked, or with a value that is not finite; no points; a
            strength below 0.
    """

    points: np.ndarray
    strength: np.ndarray | None = None
    stamp: float = 0.0
    prior: PosePrior | None = None
    name: str = "scan"
    viewpoints: np.ndarray | None = None
    times: np.ndarray | None = None

    def __post_init__(self) -> None:
        points = self.points
        for name in ("points", "strength", "viewpoints", "times"):
            array = getattr(self, name)
            refuse_mask(array, self.name)
            if not isinstance(array, np.ndarray) and (array is not None or name == "points"):
                raise InputError(f"{self.name}: `{name}` are {type(array).__name__}; wanted an array of float32")
        if points.ndim != 2 or points.shape[1] != 3 or points.dtype != np.float32:
            raise InputError(
                f"{self.name}: `points` are {points.dtype} of shape {points.shape}; wanted float32 of shape (N, 3)"
            )
        if len(points) == 0:
            raise InputError(f"{self.name}: the scan has no points; give a scan with at least one finite point")
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points).all(axis=1)).sum())
            raise InputError(f"{self.name}: {bad} of {len(points)} points are NaN or infinite; drop them first")
        for name, shape in (("strength", points.shape[:1]), ("viewpoints", points.shape), ("times", points.shape[:1])):
            if (array := getattr(self, name)) is not None:
                self._check(name, array, shape)

    def _check(self, name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
        if array.shape != shape or array.dtype != np.float32:
            raise InputError(
                f"{self.name}: `{name}` is {array.dtype} of shape {array.shape}; wanted float32 of shape {shape}, a "
                "row for each point"
            )
        usable, wrong = np.isfinite(array), "NaN or infinite"
        if name == "strength":
            usable, wrong = usable & (array >= 0), "negative, NaN or infinite"
        if bad := int((~usable.reshape(len(array), -1).all(axis=1)).sum()):
            raise InputError(
                f"{self.name}: {bad} of {len(array)} rows of `{name}` are {wrong}; correct them, or leave `{name}` out"
            )
