"""One scan: the points that a sensor saw from one pose."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError


@dataclass(frozen=True, slots=True)
class PosePrior:
    """What the vehicle's own instruments say about a scan's pose.

    Attributes:
        T_world_sensor: the measured pose (world East-North-Up, sensor x forward, y left, z up).
        sigmas: (6,) standard deviations, rotation first [rad], then translation [m]; inf where not measured.
    """

    T_world_sensor: RigidTransform
    sigmas: np.ndarray


@dataclass(frozen=True, slots=True)
class Scan:
    """Points in the frame of the sensor that saw them.

    Attributes:
        points: (N, 3) float32 [m], sensor frame (x forward, y left, z up), all finite, N >= 1.
        strength: (N,) float32, linear echo strength >= 0, or None where the sensor gives none.
        stamp: time of the scan [s, UTC]; a counter where the files carry no time.
        prior: what other instruments say about the pose, or None.
        name: what to call the scan in messages and tables.
    """

    points: np.ndarray
    strength: np.ndarray | None = None
    stamp: float = 0.0
    prior: PosePrior | None = None
    name: str = "scan"

    def __post_init__(self) -> None:
        points = self.points
        if points.ndim != 2 or points.shape[1] != 3 or points.dtype != np.float32:
            raise InputError(
                f"{self.name}: points are {points.dtype} of shape {points.shape}; wanted float32 of shape (N, 3)"
            )
        if len(points) == 0:
            raise InputError(f"{self.name}: the scan has no points; give a scan with at least one finite point")
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points).all(axis=1)).sum())
            raise InputError(f"{self.name}: {bad} of {len(points)} points are NaN or infinite; drop them first")
        if self.strength is not None and self.strength.shape != (len(points),):
            raise InputError(
                f"{self.name}: strength has shape {self.strength.shape}; wanted ({len(points)},), one per point"
            )
