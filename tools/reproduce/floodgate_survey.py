"""The scans of Sect. 4 of the paper, simulated: eighteen along a way through a flood gate, and what is true of them."""

from dataclasses import dataclass
from functools import lru_cache

from scipy.spatial.transform import RigidTransform

from spectral.scan import Scan
from tools.simulate.overlap import mutual_overlap
from tools.simulate.scenes import build_scene
from tools.simulate.simulation import SimulationSettings, simulate
from tools.simulate.solids import Mesh

SCENE = "floodgate"
SCANS = 18


@dataclass(frozen=True, slots=True)
class Survey:
    """Scans of one scene, in the order in which they were taken.

    Attributes:
        scans: in their sensor frames.
        T_world_sensor: their true poses; the world is the scene's frame, East-North-Up.
        mesh: the scene's true surface [m, world].
    """

    scans: tuple[Scan, ...]
    T_world_sensor: RigidTransform
    mesh: Mesh

    def step(self, source: int) -> RigidTransform:
        """The true T_target_source of the pair source - 1 (target), source (source)."""
        return self.T_world_sensor[source - 1].inv() * self.T_world_sensor[source]

    def overlap(self, source: int) -> float:
        """The share of points of the pair source - 1, source that have a true counterpart, the smaller of both ways."""
        return mutual_overlap(self.scans[source - 1].points, self.scans[source].points, self.step(source))


@lru_cache(maxsize=1)
def survey(seed: int, count: int = SCANS) -> Survey:
    """The survey from `seed`: the same seed, the same scans."""
    simulation = simulate(SimulationSettings(scene=SCENE, trajectory="survey", count=count, seed=seed))
    return Survey(simulation.scans, simulation.truth.T_world_sensor, build_scene(SCENE, seed).mesh)
