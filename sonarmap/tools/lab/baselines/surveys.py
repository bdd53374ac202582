"""Other systems that map a whole survey: from ordered scans and a voxel to poses and the pairs that were tried.

Multiway registration (Choi, Zhou and Koltun 2015, DOI 10.1109/CVPR.2015.7299195), by Open3D, as in its tutorial and
its reconstruction system: pairwise registrations, then one pose graph with a line process over its loops.

KISS-SLAM (Guadagnino et al. 2025, arXiv 2503.12660): odometry by KISS-ICP, loop closures between local maps, and a pose
graph. It is designed for a LiDAR with a full view at 10 Hz; it copes with motions of two voxels between the scans of a
sonar, but not with motions of four.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.extras import load_package
from sonarmap.tools.files.map_folder.names import CHAIN, TriedPair
from sonarmap.tools.lab.baselines.features import MATCH_REACH, FeatureRegistrar
from sonarmap.tools.lab.baselines.points import ThinnedCloud, one_thread, silent, to_open3d


@dataclass(frozen=True, slots=True)
class SlamRun:
    """The result of a system: poses of the scans that it could use."""

    trajectory: Trajectory  # with the scans' stamps, in an arbitrary world frame
    pairs: tuple[TriedPair, ...]  # all that it registered, kept or not; empty if it does not register pairs of scans
    loops: int  # number of loop closures that it kept
    seconds: float  # wall time, from the first scan to the last pose


KEY_EVERY = 5  # index difference of key scans, whose pairs are all tried as loops
LEAST_OVERLAP = 0.3  # point matches of a loop, over the points of the smaller scan, as in register_fragments
PRUNE = 0.25  # edge_prune_threshold of the line process, as in the reconstruction system
LOOP_PREFERENCE = 5.0  # preference_loop_closure, as there


def run_multiway(scans: Sequence[Scan], voxel: float, seed: int = 0, key_every: int = KEY_EVERY) -> SlamRun:
    """Map a survey: register consecutive scans and all pairs of key scans by FPFH, RANSAC and ICP, then optimize.

    Consecutive scans are registered globally, too, as ICP from the identity does not converge over meters; their edges
    are certain, those of loops uncertain, as in the tutorial. A scan with too few points has no pose, and its neighbors
    count as consecutive. Scans are thinned to `voxel` [m]. Raises InputError: fewer than two scans have enough points.
    """
    start = perf_counter()
    registrar = FeatureRegistrar(voxel, "ransac", seed)
    described = _describe(registrar, scans)
    usable = list(described)
    if len(usable) < 2:
        raise InputError(f"{len(usable)} of {len(scans)} scans have enough points; multiway registration needs two")
    chain = list(pairwise(usable))
    loops = sorted(set(combinations(usable[::key_every], 2)) - set(chain))
    registered = {(i, j): registrar.register(described[i], described[j]).T_target_source for i, j in [*chain, *loops]}
    reach = MATCH_REACH * voxel
    with one_thread():
        information = {(i, j): _information(described[i], described[j], T, reach) for (i, j), T in registered.items()}
        overlapping = {pair for pair in loops if _overlap(described, pair, information[pair]) >= LEAST_OVERLAP}
        poses, kept = _optimize(usable, chain, [p for p in loops if p in overlapping], registered, information, reach)
    roles = dict.fromkeys(chain, CHAIN) | dict.fromkeys(loops, "loop")
    stamps = np.array([scans[k].stamp for k in usable], np.float64)
    return SlamRun(
        trajectory=Trajectory(stamps, poses),
        pairs=tuple(TriedPair(*pair, roles[pair], pair in kept, T) for pair, T in registered.items()),
        loops=sum(pair in kept for pair in loops),
        seconds=perf_counter() - start,
    )


def _describe(registrar: FeatureRegistrar, scans: Sequence[Scan]) -> dict[int, ThinnedCloud]:
    """Features of the scans that have enough points, by index."""
    described = {}
    for index, scan in enumerate(scans):
        try:
            described[index] = registrar.prepare(scan)
        except InputError:
            continue
    return described


def _information(target: ThinnedCloud, source: ThinnedCloud, T: RigidTransform, reach: float) -> np.ndarray:
    """(6, 6) information of a pair's point matches, rotation first as in Open3D; [5, 5] is their number."""
    import open3d as o3d

    return np.asarray(
        o3d.pipelines.registration.get_information_matrix_from_point_clouds(
            to_open3d(source), to_open3d(target), reach, T.as_matrix()
        )
    )


def _overlap(described: dict[int, ThinnedCloud], pair: tuple[int, int], information: np.ndarray) -> float:
    return float(information[5, 5]) / min(len(described[k].points) for k in pair)


def _optimize(
    usable: Sequence[int],
    chain: Sequence[tuple[int, int]],
    loops: Sequence[tuple[int, int]],
    registered: dict[tuple[int, int], RigidTransform],
    information: dict[tuple[int, int], np.ndarray],
    reach: float,
) -> tuple[RigidTransform, set[tuple[int, int]]]:
    """Poses of the usable scans, the first at the identity, and the pairs that the line process kept."""
    import open3d as o3d

    r: Any = o3d.pipelines.registration
    node = {scan: index for index, scan in enumerate(usable)}
    graph, pose = r.PoseGraph(), RigidTransform.identity()
    graph.nodes.append(r.PoseGraphNode(pose.as_matrix()))
    for pair in chain:
        pose = pose * registered[pair]
        graph.nodes.append(r.PoseGraphNode(pose.as_matrix()))
    for pairs, uncertain in ((chain, False), (loops, True)):
        for i, j in pairs:
            T = registered[i, j].as_matrix()
            graph.edges.append(r.PoseGraphEdge(node[j], node[i], T, information[i, j], uncertain=uncertain))
    r.global_optimization(
        graph,
        r.GlobalOptimizationLevenbergMarquardt(),
        r.GlobalOptimizationConvergenceCriteria(),
        r.GlobalOptimizationOption(
            max_correspondence_distance=reach,
            edge_prune_threshold=PRUNE,
            preference_loop_closure=LOOP_PREFERENCE,
            reference_node=0,
        ),
    )
    poses = RigidTransform.from_matrix(np.stack([np.asarray(node.pose) for node in graph.nodes]))
    kept = {(usable[edge.target_node_id], usable[edge.source_node_id]) for edge in graph.edges}
    return poses, kept


# Lengths that scale with the voxel, in the proportion of KISS-SLAM's defaults for voxels of 1 m
_LOCAL_VOXEL = 0.5  # edge in local maps and their density images [voxels]
_FIRST_THRESHOLD = 2.0  # initial threshold of the odometry [voxels]
_THREADS = 1  # sums over several threads differ in their last bits from run to run


def run_kiss_slam(scans: Sequence[Scan], voxel: float) -> SlamRun:
    """Map a survey with default settings, but without deskewing and with lengths that fit the sensor and the odometry's
    `voxel` [m]. Raises InputError: the package is not installed."""
    config = load_package("kiss_slam.config", "kiss-slam", "the method kiss-slam", "slam-peers").KissSLAMConfig()
    slam_module = load_package("kiss_slam.slam", "kiss-slam", "the method kiss-slam", "slam-peers")
    _fit(config, voxel, max(float(np.linalg.norm(scan.points, axis=1).max()) for scan in scans))
    start = perf_counter()
    with silent((1, 2)), one_thread():
        slam = slam_module.KissSLAM(config)
        for scan in scans:
            slam.process_scan(np.ascontiguousarray(scan.points, np.float64), np.empty(0))
        # the end of its own pipeline: close the last local map and optimize all poses
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
