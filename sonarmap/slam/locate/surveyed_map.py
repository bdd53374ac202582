"""A finished map in which scans are located, and what a sensor would see of it from a pose."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import propagated
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior, Scan

_FEWEST = 50  # points of a key scan's own
_MOST = 0.95  # share of a scan's points that are within its reach, and its field of view
_APART = 8.0  # [voxels], about as far as key scans are apart
_TURNED = np.radians(15.0)
LEAST = np.repeat([1e-3, 1e-2], 3)  # no pose of a map is taken to be known better [rad, m]


@dataclass(frozen=True, slots=True)
class View:
    """The cone in which most points of a scan are."""

    reach: float  # its length [m]
    middle: np.ndarray  # (3,) unit vector, sensor frame
    cosine: float  # of the angle between its middle and its rim

    @classmethod
    def of(cls, points: np.ndarray) -> "View":
        """Of a scan's points (N, 3) [m, sensor frame]."""
        far = np.maximum(np.linalg.norm(points, axis=1), 1e-9)
        mean = points.mean(axis=0, dtype=np.float64)
        middle = mean / max(float(np.linalg.norm(mean)), 1e-9)
        cosine = np.quantile(points @ middle / far, 1 - _MOST)
        return cls(float(np.quantile(far, _MOST)), middle, float(cosine))


@dataclass(frozen=True, slots=True)
class SurveyedMap:
    """The points of a finished map of n scans, and the poses from which they were seen."""

    points: np.ndarray  # (M, 3) float64 [m, map frame]
    seen_by: np.ndarray  # (M,) int, 0..n-1, the scan that each is mostly of
    T_map_sensor: RigidTransform  # n poses
    covariances: np.ndarray  # (n, 6, 6) of these, rotation first [rad, m], body tangent
    voxel: float  # edge of the map's voxels [m]
    # (6,) bool, what instruments measured of the frame, as `slam.graph.gauge.MEASURED` lists it; priors count only then
    measured: np.ndarray

    @property
    def apart(self) -> list[int]:
        """The scans in whose place a key scan is made of the map's points: apart, with enough points of their own.

        Raises InputError: there is none."""
        counts, chosen = np.bincount(self.seen_by, minlength=len(self.covariances)), list[int]()
        for n in np.flatnonzero(counts >= _FEWEST).tolist():
            if not chosen or self._far_from(chosen[-1], n):
                chosen.append(n)
        if not chosen:
            raise InputError(f"no scan of the map has {_FEWEST} points of its own in it; nothing to find a place by")
        return chosen

    def key_scan(self, key: int) -> Scan:
        """The map as it is seen from the place of a scan, as far as that saw."""
        return Scan(self.seen_from(self.T_map_sensor[key], self.view_of(key)))

    def key_scans(self) -> list[Scan]:
        """Those of all that are `apart`: what a grid has to suit."""
        return [self.key_scan(key) for key in self.apart]

    def view_of(self, key: int) -> "View":
        """In which most of the points lie that are mostly of this scan."""
        return View.of(self.T_map_sensor[key].inv().apply(self.points[self.seen_by == key]))

    def seen_from(self, T_map_sensor: RigidTransform, view: View) -> np.ndarray:
        """(N, 3) float32 [m, sensor frame]: the map's points within a view from a pose."""
        near = np.linalg.norm(self.points - T_map_sensor.translation, axis=1) <= view.reach
        points = T_map_sensor.inv().apply(self.points[near])
        within = points @ view.middle >= view.cosine * np.linalg.norm(points, axis=1)
        return points[within].astype(np.float32)

    def covariance_at(self, T_map_scan: RigidTransform) -> np.ndarray:
        """(6, 6), rotation first [rad, m], body tangent of the pose: how sure the map is of the place about it, as the
        nearest of its own poses has it."""
        apart = np.linalg.norm(self.T_map_sensor.translation - T_map_scan.translation, axis=1)
        nearest = int(np.argmin(apart))
        return propagated(T_map_scan.inv() * self.T_map_sensor[nearest], self.covariances[nearest])

    def prior_at(self, T_map_sensor: RigidTransform) -> PosePrior | None:
        """What a scan there is known to be measured at, which registers with scans that have priors too; None where no
        instrument measured anything of the map's frame."""
        if not self.measured.any():
            return None
        R = np.zeros((6, 6))
        R[3:, 3:] = T_map_sensor.rotation.as_matrix()
        heading = Rotation.from_euler("Z", twist(T_map_sensor.rotation))  # a prior's roll and pitch are turned by it
        R[:3, :3] = heading.as_matrix().T @ R[3:, 3:]
        sigmas = np.hypot(np.sqrt(np.maximum(np.diag(R @ self.covariance_at(T_map_sensor) @ R.T), 0.0)), LEAST)
        known = self.measured.copy()
        known[:2], known[3:5] = known[:2].all(), known[3:5].all()
        return PosePrior(T_map_sensor, np.where(known, sigmas, np.inf))

    def _far_from(self, a: int, b: int) -> bool:
        T = self.T_map_sensor[a].inv() * self.T_map_sensor[b]
        return bool(np.linalg.norm(T.translation) > _APART * self.voxel or T.rotation.magnitude() > _TURNED)
