"""The surveys that are mapped: a lawn-mower over a scene, some of its scans unusable; or two dives over it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.settings import check_scenes, check_seeds
from sonarmap.tools.lab.reproduce.survey.mapped import SYSTEMS
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import simulate

DIVES = "dives"


@dataclass(frozen=True, slots=True)
class SurveySettings:
    """What is run."""

    scene: str = "floodgate"  # a key of SCENE_KINDS
    seeds: int = 1  # how many surveys, each with a scene, a sea and a noise of its own, counted from `first_seed`
    first_seed: int = 5  # >= 0
    counts: tuple[int, ...] = (50, 100, 200)  # of the scans of a survey; the peers map the longest alone
    dive: int = 60  # scans of each of two dives over one place; 0 for none
    unusable: float = 0.03  # share of the scans that show nothing of the scene
    edge: int = 128  # voxels per edge; their size is chosen for the survey, as `sonarmap map` does
    systems: tuple[str, ...] = SYSTEMS  # of SYSTEMS
    left_out: tuple[str, ...] = ()  # systems that would have run were their packages installed

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_scenes((self.scene,))
        check_seeds(self.seeds, self.first_seed)
        if not self.counts or min(self.counts) < 2 or self.dive < 0:
            raise InputError(f"{self.counts} scans and dives of {self.dive}; a survey needs 2 scans or more")


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

    The scene is a key of SCENE_KINDS, the seed that of the scene, the waves and the noise; a share of the scans is
    unusable: it shows nothing of the scene. `dives` are as `tools.lab.simulate.paths.trajectories` counts them.
    """
    settings = replace(plan(scene, "lawnmower", None, seed), count=count, unusable=unusable)
    done = [simulate(replace(settings, dive=dive)) for dive in dives]
    scans = [scan for simulation in done for scan in simulation.scans]
    poses = RigidTransform.concatenate([simulation.truth.T_world_sensor for simulation in done])
    return SimulatedSurvey(
        scans=tuple(replace(scan, stamp=float(k), name=f"scan_{k:03d}") for k, scan in enumerate(scans)),
        truth=Trajectory(np.arange(len(scans), dtype=np.float64), poses),
        dives=np.repeat(np.arange(len(done)), count),
        unusable=frozenset(number + k * count for k, each in enumerate(done) for number in each.faults),
        mesh=build_scene(scene, seed).mesh,
    )
