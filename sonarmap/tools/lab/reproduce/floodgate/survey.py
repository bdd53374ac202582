"""The scans of Sect. 4 of the paper, simulated: eighteen along a way before a flood gate, and what is true of them."""

from dataclasses import dataclass, replace
from functools import lru_cache

from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.paths.stations import COLUMNS, PAPER_COUNT, ROWS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import mutual_overlap, shared_view
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import Simulation, SimulationSettings, simulate

SCENE = "floodgate"
SCANS = PAPER_COUNT


@dataclass(frozen=True, slots=True)
class FloodgateSurvey:
    """N scans of one scene, in the order in which they were taken.

    Attributes:
        scans: in their sensor frames.
        T_world_sensor: their true poses; the world is the scene's frame, East-North-Up.
        mesh: the scene's true surface [m, world].
        overlap: N - 1 shares of points that truly have a counterpart in the scan before, the smaller of both ways.
        shared: N - 1 shares of what a scan shows that lies in the view of the scan before, the smaller of both ways,
            without noise.
    """

    scans: tuple[Scan, ...]
    T_world_sensor: RigidTransform
    mesh: Mesh
    overlap: tuple[float, ...]
    shared: tuple[float, ...]

    def step(self, source: int) -> RigidTransform:
        """The true T_target_source of the pair source - 1 (target), source (source)."""
        return self.T_world_sensor[source - 1].inv() * self.T_world_sensor[source]


@lru_cache(maxsize=1)
def survey(seed: int, count: int = SCANS) -> FloodgateSurvey:
    """The survey from `seed`: the same seed, the same scans."""
    simulation = simulate(SimulationSettings(scene=SCENE, trajectory="paper18", count=count, seed=seed))
    poses = simulation.truth.T_world_sensor
    pairs = range(1, count)
    return FloodgateSurvey(
        scans=simulation.scans,
        T_world_sensor=poses,
        mesh=build_scene(SCENE, seed).mesh,
        overlap=tuple(_overlap(simulation, source) for source in pairs),
        shared=tuple(_shared(simulation, source) for source in pairs),
    )


def _overlap(simulation: Simulation, source: int) -> float:
    target, moved = simulation.scans[source - 1], simulation.scans[source]
    poses = simulation.truth.T_world_sensor
    return mutual_overlap(target.points, moved.points, poses[source - 1].inv() * poses[source])


def _shared(simulation: Simulation, source: int) -> float:
    """With as few beams as the way was laid out with."""
    settings = simulation.settings
    sensor = replace(settings.sensor, columns=COLUMNS, rows=ROWS)
    poses = simulation.truth.T_world_sensor
    return shared_view(build_scene(SCENE, settings.seed), sensor, poses[source - 1], poses[source])
