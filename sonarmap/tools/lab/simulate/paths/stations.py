"""Scans as far apart as a wanted overlap allows: the survey of the paper's Sect. 4."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.simulate.paths.routes import gate_path
from sonarmap.tools.lab.simulate.paths.smooth_path import Path
from sonarmap.tools.lab.simulate.paths.trajectories import poses_along
from sonarmap.tools.lab.simulate.scenes.scene import Scene, build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import shared_view
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor, bare

GATE = "floodgate"
PAPER_COUNT = 18
MOST_SHARED, LEAST_SHARED = 0.88, 0.52  # wanted between consecutive scans; the paper: about 90 to 50 percent
GOLDEN = (np.sqrt(5.0) - 1) / 2
STEP = 1.0  # of the search along the path in a scene of 256 m [m]
COLUMNS, ROWS = 64, 48  # of the beams that overlap is measured with, at most


def paper18(scene: str, count: int, seed: int, sensor: Sensor) -> Trajectory:
    """Up to 18 poses, each as far along a path as its wanted overlap with the one before allows.

    The overlap is `shared_view`, measured on the scene itself without noise, with fewer beams; the wanted shares vary
    between 0.9 and 0.5 in a fixed order. The path shows the gate from shore to shore; the vessel moves as in `survey`.
    Raises InputError: fewer scans than 1 or more than 18, another scene, or a path that is too short.
    """
    if not 1 <= count <= PAPER_COUNT:
        raise InputError(f"the paper's survey has {PAPER_COUNT} scans; {count} were asked for")
    if scene != GATE:
        raise InputError(
            f"the paper's survey is laid through {GATE}, not through {scene}; take a survey or a lawnmower"
        )
    path = gate_path()
    coarse = replace(bare(sensor), columns=min(sensor.columns, COLUMNS), rows=min(sensor.rows, ROWS))
    distance = stations(build_scene(scene, seed), path, coarse, wanted_shares(count - 1), seed)
    return Trajectory(np.arange(count, dtype=np.float64), poses_along(path, distance, scene, seed))


def wanted_shares(count: int) -> np.ndarray:
    """Wanted overlaps (N,) that wander evenly between the greatest and the least, the same whatever the seed."""
    return MOST_SHARED - (MOST_SHARED - LEAST_SHARED) * np.sqrt(GOLDEN * np.arange(1, count + 1) % 1)


def stations(scene: Scene, path: Path, sensor: Sensor, shares: np.ndarray, seed: int) -> np.ndarray:
    """Distances (N + 1,) [m] along `path`: each the last before the overlap of what `sensor` sees with the one before
    falls below its share, of (N,), 0..1. Raises InputError: a path too short for all of them."""
    step = STEP * scene.kind.scale
    distance = [0.0]

    def last_pose(distance: list[float]) -> RigidTransform:
        return poses_along(path, np.array(distance), scene.name, seed)[-1]

    for share in shares:
        before, gone = last_pose(distance), distance[-1] + step
        while shared_view(scene, sensor, before, last_pose([*distance, gone + step])) >= share:
            gone += step
            if gone > path.length:
                raise InputError(f"the path through {scene.name} ends after {len(distance)} of {len(shares) + 1} scans")
        distance.append(gone)
    return np.array(distance)
