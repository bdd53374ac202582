"""What a scan contributes to every pair of a method that works on points: one point per voxel, with its normal."""

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan


@contextmanager
def silent(streams: Sequence[int] = (1,)) -> Iterator[None]:
    """What is written to the standard output (1), or also to the standard error (2), within goes nowhere.

    Also what C and C++ write.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = {stream: os.dup(stream) for stream in streams}, os.open(os.devnull, os.O_WRONLY)
    for stream in streams:
        os.dup2(nowhere, stream)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # C holds it back where stdout is no terminal
        for stream, before in kept.items():
            os.dup2(before, stream)
            os.close(before)
        os.close(nowhere)


@contextmanager
def quiet() -> Iterator[None]:
    """Open3D says nothing but errors within."""
    import open3d as o3d

    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Open3D is quiet within and takes one thread: what several sum up differs in its last bits from run to run."""
    import open3d as o3d

    before = o3d.utility.get_max_threads()
    o3d.utility.set_max_threads(1)
    try:
        with quiet():
            yield
    finally:
        o3d.utility.set_max_threads(before)


FEWEST_POINTS = 20  # as many as the spectral registration needs occupied voxels

# Where normals are estimated: all within this distance [voxels], the nearest so many at most (Open3D's example).
NORMAL_REACH = 2.0
NORMAL_NEIGHBORS = 30


@dataclass(frozen=True, slots=True)
class ThinnedCloud:
    """A scan's points, thinned."""

    name: str  # the scan's
    points: np.ndarray  # (m, 3) float64 [m, sensor frame], the mean of the points of every occupied voxel
    normals: np.ndarray  # (m, 3) float64, of unit length, on the side where the sensor was
    tree: KDTree  # to search among the points
    extra: Any = None  # what a method adds for itself: features, or the points as another library wants them


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
