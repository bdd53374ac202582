"""KISS-SLAM (Guadagnino et al. 2025, arXiv 2503.12660): KISS-ICP's odometry, closures between local maps, a pose graph.

It is made for a LiDAR that sees all around, ten times a second: each scan is expected where the last motion leads, and
closures are sought in views of local maps from above, with the ground leveled. A sonar's scans, meters apart and
through a narrow fan, are none of that: steps of two voxels are within its reach, steps of four are not.
"""

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.packages import one_thread, silent
from sonarmap.tools.lab.baselines.surveys.slam_run import SlamRun

# Its defaults are for a reach of 100 m and voxels of 1 m; lengths that belong to the voxel are kept in that proportion.
_LOCAL_VOXEL = 0.5  # of local maps and of the views from above [voxels]
_FIRST_THRESHOLD = 2.0  # of its odometry, until it knows the motion [voxels]
_THREADS = 1  # sums over several differ in their last bits from run to run


def run_kiss_slam(scans: Sequence[Scan], voxel: float) -> SlamRun:
    """Map a survey with its default settings, but for the lengths that depend on the sensor, and without deskewing.

    Args:
        scans: in their order.
        voxel: edge of the odometry's voxels [m].

    Raises:
        InputError: the package is not installed.
    """
    config = load_package("kiss_slam.config", "kiss-slam", "the method kiss-slam", "slam-peers").KissSLAMConfig()
    slam_module = load_package("kiss_slam.slam", "kiss-slam", "the method kiss-slam", "slam-peers")
    _fit(config, voxel, max(float(np.linalg.norm(scan.points, axis=1).max()) for scan in scans))
    start = perf_counter()
    with silent((1, 2)), one_thread():
        slam = slam_module.KissSLAM(config)
        for scan in scans:
            slam.process_scan(np.ascontiguousarray(scan.points, np.float64), np.empty(0))
        # as its own pipeline ends: the last local map is closed, and all poses are optimized
        slam.generate_new_node()
        slam.local_map_graph.erase_last_local_map()
        poses, _ = slam.fine_grained_optimization()
    seconds = perf_counter() - start
    stamps = np.array([scan.stamp for scan in scans], np.float64)
    return SlamRun(
        trajectory=Trajectory(stamps, RigidTransform.from_matrix(np.array(poses))),
        pairs=(),
        loops=len(slam.get_closures()),
        seconds=seconds,
    )


def _fit(config: Any, voxel: float, max_range: float) -> None:
    """Set the lengths that depend on the sensor."""
    odometry = config.odometry
    odometry.preprocessing.max_range = max_range + voxel
    odometry.preprocessing.deskew = False
    odometry.mapping.voxel_size = voxel
    odometry.adaptive_threshold.initial_threshold = _FIRST_THRESHOLD * voxel
    odometry.registration.max_num_threads = _THREADS
    config.local_mapper.voxel_size = _LOCAL_VOXEL * voxel
    config.loop_closer.detector.density_map_resolution = _LOCAL_VOXEL * voxel
