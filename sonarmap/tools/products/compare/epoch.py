# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""One survey of the two that are compared: its points, and what their errors share."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.joint import joint_covariance
from sonarmap.slam.graph.tangent import adjoint, propagated
from sonarmap.tools.files.map_folder.folder import Map, map_points
from sonarmap.tools.files.map_folder.names import FULL_GRAPH
from sonarmap.tools.files.readers.poses.graph_json import read_graph_json

_LEAST_NOISE = 1e-3  # [m]
_PASSING = 2  # sight lines that say that a place is free: a single one may end at a stray echo
_MOST = 300  # poses whose errors are told apart; of a longer survey so many stand for those about them


@dataclass(frozen=True, slots=True)
class Epoch:
    """A survey of M points, and n of its poses, each of which stands for those about it."""

    points: np.ndarray  # (M, 3) float64 [m]
    noise: np.ndarray  # (M,) float64 standard deviation of a coordinate [m], without what the poses do
    weight: np.ndarray  # (M,) float64, how many echoes each is the mean of
    scan: np.ndarray  # (M,) int64, 0..n-1, the pose that stands for the one that each is mostly of
    origins: np.ndarray  # (M, 3) float64 [m], where each was seen from
    # (6 n, 6 n) of the poses' errors, rotation first [rad, m], left tangents: a point p errs by w x p + v
    covariance: np.ndarray
    sides_known: bool = True  # whether origins are known, and not those of points near by

    @property
    def poses(self) -> int:
        """How many there are."""
        return len(self.covariance) // 6

    @classmethod
    def of_map(cls, folder: Map, survey: int | None = None) -> "Epoch":
        """The largest part of a finished map, or what one of its surveys saw of that, in its own frame.

        Raises InputError: files of the map are missing or damaged."""
        part = folder.parts[0]
        points, columns = part.points, part.columns
        if survey is not None:
            points, columns = map_points(folder.path / f"map{part.suffix}_survey_{survey}.ply", part.scans)
        count = len(part.scans)
        chosen = np.unique(np.linspace(0, count - 1, min(_MOST, count)).round().astype(np.intp))
        joint = joint_covariance(read_graph_json(folder.path / FULL_GRAPH), np.array(part.scans)[chosen].tolist())
        nearest = np.searchsorted((chosen[1:] + chosen[:-1]) / 2, np.arange(count))
        scan = nearest[np.searchsorted(part.scans, columns["scan"])]
        T = part.trajectory.T_world_sensor[chosen]
        by_poses = _pose_variance(points, scan, propagated(T, part.covariances[chosen]))
        noise = np.sqrt(np.maximum(columns["sigma"].astype(np.float64) ** 2 - by_poses, _LEAST_NOISE**2))
        weight = np.maximum(columns["count"].astype(np.float64), 1.0)
        return cls(points, noise, weight, scan, T.translation[scan], joint)

    @classmethod
    def of_cloud(cls, points: np.ndarray, weight: np.ndarray, sigma: float | None, beside: "Epoch") -> "Epoch":
        """A cloud of which no pose is known, so that none is taken to err, and that is seen from where the nearest
        points of the survey beside it are.

        Args:
            points: (M, 3) float64 [m], frame of the survey beside it.
            weight: (M,) float64, how many points of the cloud each is the mean of.
            sigma: standard deviation of a coordinate of one of these [m]; None where only their scatter tells.
        """
        noise = np.maximum((sigma or 0.0) / np.sqrt(weight), _LEAST_NOISE)
        near = KDTree(beside.points).query(points)[1]
        scan, exact = np.zeros(len(points), np.int64), np.zeros((6, 6))
        return cls(points, noise, weight, scan, beside.origins[near], exact, sides_known=False)

    def passes(self, places: np.ndarray, voxel: float) -> np.ndarray:
        """(n,) bool: which places (n, 3) [m] the survey saw free: it has no point within a voxel, and sight lines to
        points behind go through there."""
        free = ~np.isfinite(KDTree(self.points).query(places, distance_upper_bound=voxel)[0])
        viewpoints, which = np.unique(self.origins, axis=0, return_inverse=True)
        passing = np.zeros(len(places), np.int64)
        for number, viewpoint in enumerate(viewpoints):
            toward, offset = places - viewpoint, self.points[which.ravel() == number] - viewpoint
            away, ranges = np.linalg.norm(toward, axis=1), np.linalg.norm(offset, axis=1)
            lines = KDTree(offset / ranges[:, None])
            for at in np.flatnonzero(free & (away > voxel) & (away + voxel < ranges.max())).tolist():
                near = lines.query_ball_point(toward[at] / away[at], voxel / away[at])
                passing[at] += np.count_nonzero(ranges[near] > away[at] + voxel)
        return passing >= _PASSING

    def moved(self, T_other_this: RigidTransform) -> "Epoch":
        """The same in another frame."""
        A = block_diag(*[adjoint(T_other_this)] * self.poses)
        return replace(
            self,
            points=T_other_this.apply(self.points),
            origins=T_other_this.apply(self.origins),
            covariance=A @ self.covariance @ A.T,
        )


def levers(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(K, 6) how an error (w, v) of a left tangent moves points (K, 3) along normals (K, 3): w . (p x n) + v . n."""
    return np.hstack([np.cross(points, normals), normals])


def _pose_variance(points: np.ndarray, scan: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(M,) mean variance of the three coordinates [m^2] that the poses' (n, 6, 6) left tangents give points (M, 3)."""
    total = np.zeros(len(points))
    for axis in np.eye(3):
        J = levers(points, np.broadcast_to(axis, points.shape))
        for pose in range(len(covariances)):
            own = scan == pose
            total[own] += np.einsum("ka,ab,kb->k", J[own], covariances[pose], J[own])
    return np.maximum(total, 0.0) / 3
