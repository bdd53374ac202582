"""What a scan contributes to every pair of a method that works on points: one point per voxel, with its normal."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan

FEWEST_POINTS = 20  # as many as the spectral registration needs occupied voxels

# Where normals are estimated: all within this distance [voxels], the nearest so many at most (Open3D's example).
NORMAL_REACH = 2.0
NORMAL_NEIGHBORS = 30


@dataclass(frozen=True, slots=True)
class ThinnedCloud:
    """A scan's points, thinned.

    Attributes:
        name: the scan's.
        points: (m, 3) float64 [m, sensor frame], the mean of the points of every occupied voxel.
        normals: (m, 3) float64, of unit length, on the side where the sensor was.
        tree: to search among the points.
    """

    name: str
    points: np.ndarray
    normals: np.ndarray
    tree: KDTree


def thin(scan: Scan, voxel: float) -> ThinnedCloud:
    """One point per voxel, with its normal.

    Args:
        scan: any.
        voxel: edge of a voxel [m].

    Raises:
        InputError: the points fill too few voxels.
    """
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan.points.astype(np.float64)))
    try:
        cloud = cloud.voxel_down_sample(voxel)
    except RuntimeError as error:  # it counts the voxels along an axis in 32 bits
        raise InputError(
            f"{scan.name}: voxels of {voxel:g} m are too small for the scan's extent. Give larger ones with --voxel."
        ) from error
    if len(cloud.points) < FEWEST_POINTS:
        raise InputError(
            f"{scan.name}: its points fill {len(cloud.points)} voxels of {voxel:.3g} m; wanted at least "
            f"{FEWEST_POINTS}. Give a scan with more structure, or smaller voxels with --voxel."
        )
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_REACH * voxel, NORMAL_NEIGHBORS))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    points, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    if scan.viewpoints is not None:
        _, nearest = KDTree(scan.points).query(points)
        away = np.sum(normals * (scan.viewpoints[nearest] - points), axis=1) < 0
        normals = np.where(away[:, None], -normals, normals)
    return ThinnedCloud(scan.name, points, normals, KDTree(points))


def to_open3d(cloud: ThinnedCloud) -> Any:
    """The same as Open3D's PointCloud."""
    import open3d as o3d

    converted = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points))
    converted.normals = o3d.utility.Vector3dVector(cloud.normals)
    return converted
