"""Calibration of poses: their errors compared with the uncertainty that their covariances state."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.geometry import twist

LEVEL = 0.95  # probability of the confidence ellipsoids
# The world frames differ if few true positions are in their ellipsoids and a common shift is most of the error
_MAX_INSIDE = 0.2  # share of the positions in their ellipsoids
_MIN_SHIFT = 5.0  # ratio of the shift to the root mean square of the remaining errors
FIXED = 1e-3  # an anchor's largest sigma [rad, m]: a graph's gauge is far below it, any measured prior above


@dataclass(frozen=True, slots=True)
class PoseCalibration:
    """The errors of N poses compared with their covariances. Errors of poses of the same graph are correlated."""

    # "first": errors are relative to the first pose, which is left out; "world": poses are compared in the world, not
    # aligned, as the first pose is itself uncertain (priors); "partly": likewise, but the degrees of freedom that no
    # instrument measured are aligned at the first pose
    anchor: Literal["first", "world", "partly"]
    nees: np.ndarray  # (N,) squared Mahalanobis distance of the truth, 6 on average where the covariance is right
    position_nees: np.ndarray  # (N,) the same of the position alone, 3 on average
    offset: np.ndarray  # (3,) mean of the true minus the estimated positions [m]
    rest: np.ndarray  # (N,) length of each position's error after this mean is subtracted [m]

    @property
    def origins_differ(self) -> bool:
        """Whether nearly all of the error is a common shift: both world frames probably differ."""
        shift, remaining = float(np.linalg.norm(self.offset)), float(np.sqrt((self.rest**2).mean()))
        return self.anchor != "first" and self.position_within_95 < _MAX_INSIDE and shift > _MIN_SHIFT * remaining

    @property
    def within_95(self) -> float:
        """Share of the poses whose truth lies in the 95 % ellipsoid of all six degrees of freedom."""
        return float((self.nees <= chi2.ppf(LEVEL, 6)).mean())

    @property
    def position_within_95(self) -> float:
        """Share of the poses whose true position lies in the 95 % ellipsoid of the position."""
        return float((self.position_nees <= chi2.ppf(LEVEL, 3)).mean())

    def to_json(self) -> dict[str, Any]:
        """The shares in the ellipsoids, the mean distances and the common shift."""
        return {
            "anchor": self.anchor,
            "poses": len(self.nees),
            "within_95": self.within_95,
            "position_within_95": self.position_within_95,
            "nees_mean": float(self.nees.mean()),
            "position_nees_mean": float(self.position_nees.mean()),
            "offset_m": self.offset.tolist(),
            "origins_differ": self.origins_differ,
        }


def calibrate_poses(
    T_world_sensor: RigidTransform,
    truth: RigidTransform,
    covariances: np.ndarray,
    unmeasured: Collection[str] = (),
) -> PoseCalibration | None:
    """Compare the errors of N poses with their covariances; None if the only pose is an exactly known first one.

    The covariances (N, 6, 6), rotation first [rad, m], are of xi in T_true = T_estimate Exp(xi), the body tangent. If
    the first is close to zero, errors are relative to the first pose. `unmeasured` names the degrees of freedom of the
    world that no instrument measured (`slam.graph.gauge.MEASURED`). Raises InputError: a covariance is singular.
    """
    fixed = bool(np.sqrt(np.diag(covariances[0]).max()) < FIXED)
    if fixed and len(covariances) == 1:
        return None
    if fixed:
        T_world_sensor, truth = (T[0].inv() * T[1:] for T in (T_world_sensor, truth))
        covariances = covariances[1:]
    else:
        T_world_sensor = _align_first(truth[0], T_world_sensor, unmeasured)
    xi = (T_world_sensor.inv() * truth).as_exp_coords()
    return PoseCalibration(
        anchor="first" if fixed else "partly" if unmeasured else "world",
        nees=_squared_mahalanobis(xi, covariances),
        position_nees=_squared_mahalanobis(xi[:, 3:], covariances[:, 3:, 3:]),
        offset=(offset := (errors := truth.translation - T_world_sensor.translation).mean(axis=0)),
        rest=np.linalg.norm(errors - offset, axis=1),
    )


def _align_first(first: RigidTransform, T_world_sensor: RigidTransform, unmeasured: Collection[str]) -> RigidTransform:
    """Poses moved as a whole so that the unmeasured degrees of freedom of the first agree with the true first pose."""
    correction = first.rotation * T_world_sensor[0].rotation.inv()
    turn = Rotation.identity()
    if {"tilt_x", "tilt_y"} & set(unmeasured):
        turn = correction
    elif "heading" in unmeasured:
        turn = Rotation.from_euler("Z", twist(correction))
    place = T_world_sensor[0].translation
    shift = np.where([name in unmeasured for name in ("east", "north", "up")], first.translation - place, 0.0)
    about = RigidTransform.from_translation(place)
    moved = RigidTransform.from_translation(shift) * about * RigidTransform.from_rotation(turn)
    return moved * (about.inv() * T_world_sensor)


def _squared_mahalanobis(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Squared Mahalanobis distances (N,) of errors (N, D)."""
    try:
        weighted = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError as error:
        raise InputError(
            "a pose's covariance is singular, so that its error cannot be compared with it; give the summary as "
            "`sonarmap map` wrote it, or leave it out"
        ) from error
    return np.einsum("ni,ni->n", errors, weighted)
