"""A finished map in which scans are located, and its views from poses."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import propagated
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior, Scan

_MIN_POINTS = 50  # of the map that are mostly of a key scan
_QUANTILE = 0.95  # share of a scan's points within its reach, and within its cone
_KEY_SHIFT = 8.0  # between key scans [voxels], or
_KEY_TURN = np.radians(15.0)  # [rad]
LEAST = np.repeat([1e-3, 1e-2], 3)  # added to the standard deviations of the map's poses [rad, m]


@dataclass(frozen=True, slots=True)
class View:
    """The cone in which most points of a scan are."""

    reach: float  # length of the cone [m]
    middle: np.ndarray  # (3,) unit vector of its axis, sensor frame
    cosine: float  # of the angle between its axis and its rim

    @classmethod
    def of(cls, points: np.ndarray) -> "View":
        """The view of a scan with (N, 3) points [m, sensor frame]."""
        ranges = np.maximum(np.linalg.norm(points, axis=1), 1e-9)
        mean = points.mean(axis=0, dtype=np.float64)
        middle = mean / max(float(np.linalg.norm(mean)), 1e-9)
        cosine = np.quantile(points @ middle / ranges, 1 - _QUANTILE)
        return cls(float(np.quantile(ranges, _QUANTILE)), middle, float(cosine))


@dataclass(frozen=True, slots=True)
class SurveyedMap:
    """The points of a finished map of n scans, and the poses from which they were seen."""

    points: np.ndarray  # (M, 3) float64 [m, map frame]
    seen_by: np.ndarray  # (M,) int, 0..n-1, the scan with most of each point's echoes
    T_map_sensor: RigidTransform  # n poses
    covariances: np.ndarray  # (n, 6, 6) of these, rotation first [rad, m], body tangent
    voxel: float  # edge of the map's voxels [m]
    # (6,) bool, directions of the map frame that instruments measured (`slam.graph.gauge.MEASURED`); priors need them
    measured: np.ndarray

    @property
    def apart(self) -> list[int]:
        """The scans at whose poses key scans are made: some distance apart, each with enough of the map's points.

        Raises InputError: there is none."""
        counts, chosen = np.bincount(self.seen_by, minlength=len(self.covariances)), list[int]()
        for n in np.flatnonzero(counts >= _MIN_POINTS).tolist():
            if not chosen or self._are_apart(chosen[-1], n):
                chosen.append(n)
        if not chosen:
            raise InputError(f"no scan of the map has {_MIN_POINTS} points of its own; no scan can be located in it")
        return chosen

    def key_scan(self, key: int) -> Scan:
        """The map seen from a scan's pose, within that scan's view."""
        return Scan(self.seen_from(self.T_map_sensor[key], self.view_of(key)))

    def key_scans(self) -> list[Scan]:
        """The key scans at all poses of `apart`; the registrar's grid has to suit them."""
        return [self.key_scan(key) for key in self.apart]

    def view_of(self, key: int) -> "View":
        """The view with most of the map's points that are mostly of this scan."""
        return View.of(self.T_map_sensor[key].inv().apply(self.points[self.seen_by == key]))

    def seen_from(self, T_map_sensor: RigidTransform, view: View) -> np.ndarray:
        """(N, 3) float32 [m, sensor frame]: the map's points within a view from a pose."""
        near = np.linalg.norm(self.points - T_map_sensor.translation, axis=1) <= view.reach
        points = T_map_sensor.inv().apply(self.points[near])
        within = points @ view.middle >= view.cosine * np.linalg.norm(points, axis=1)
        return points[within].astype(np.float32)

    def covariance_at(self, T_map_scan: RigidTransform) -> np.ndarray:
        """(6, 6) covariance of the map around a pose, by its nearest scan: rotation first [rad, m], body tangent of the
        pose."""
        distances = np.linalg.norm(self.T_map_sensor.translation - T_map_scan.translation, axis=1)
        nearest = int(np.argmin(distances))
        return propagated(T_map_scan.inv() * self.T_map_sensor[nearest], self.covariances[nearest])

    def prior_at(self, T_map_sensor: RigidTransform) -> PosePrior | None:
        """The prior of a view from a pose, for registration to scans with priors; None if no instrument measured the
        map frame."""
        if not self.measured.any():
            return None
        R = np.zeros((6, 6))
        R[3:, 3:] = T_map_sensor.rotation.as_matrix()
        heading = Rotation.from_euler("Z", twist(T_map_sensor.rotation))  # axes of the prior's roll, pitch errors
        R[:3, :3] = heading.as_matrix().T @ R[3:, 3:]
        sigmas = np.hypot(np.sqrt(np.maximum(np.diag(R @ self.covariance_at(T_map_sensor) @ R.T), 0.0)), LEAST)
        measured = self.measured.copy()
        measured[:2], measured[3:5] = measured[:2].all(), measured[3:5].all()
        return PosePrior(T_map_sensor, np.where(measured, sigmas, np.inf))

    def _are_apart(self, a: int, b: int) -> bool:
        T = self.T_map_sensor[a].inv() * self.T_map_sensor[b]
        return bool(np.linalg.norm(T.translation) > _KEY_SHIFT * self.voxel or T.rotation.magnitude() > _KEY_TURN)
