"""The surveys that are mapped: a lawn-mower over a scene, some of its scans unusable; or two dives over it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate


@dataclass(frozen=True, slots=True)
class SimulatedSurvey:
    """N scans, and what is true of them."""

    scans: tuple[Scan, ...]  # one dive's after another's; their stamps count them from 0
    truth: Trajectory  # their poses; the world is the scene's frame, East-North-Up
    dives: np.ndarray  # (N,) int, the number of the survey of each scan, as given to the mapper
    unusable: frozenset[int]  # the scans that show nothing of the scene
    mesh: Mesh  # the scene's true surface [m, world]


def simulate_survey(scene: str, seed: int, count: int, unusable: float, dives: Sequence[int] = (1,)) -> SimulatedSurvey:
    """Simulate `count` scans of each of the dives, in their order; their relative pose is given nowhere.

    Args:
        scene: a key of SCENE_KINDS.
        seed: of the scene, the waves and the noise.
        count: of the scans of a dive.
        unusable: share of these that show nothing of the scene.
        dives: as `tools.lab.simulate.paths.trajectories` counts them.
    """
    settings = replace(plan(scene, "lawnmower", None, seed), count=count, unusable=unusable)
    done = [simulate(replace(settings, dive=dive)) for dive in dives]
    scans = [scan for simulation in done for scan in simulation.scans]
    poses = RigidTransform.concatenate([simulation.truth.T_world_sensor for simulation in done])
    return SimulatedSurvey(
        scans=tuple(replace(scan, stamp=float(k), name=f"scan_{k:03d}") for k, scan in enumerate(scans)),
        truth=Trajectory(np.arange(len(scans), dtype=np.float64), poses),
        dives=np.repeat(np.arange(len(done)), count),
        unusable=_faults(done, count),
        mesh=build_scene(scene, seed).mesh,
    )


def _faults(done: Sequence[Simulation], count: int) -> frozenset[int]:
    return frozenset(number + k * count for k, simulation in enumerate(done) for number in simulation.faults)
