"""Whole surveys, mapped: how far off poses and maps are, what became of right and wrong pairs, and what it takes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Section, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked, check_scenes, check_seeds
from sonarmap.tools.lab.reproduce.survey.mapped import OURS, PEERS, SYSTEMS, MappingTime, installed, map_survey
from sonarmap.tools.lab.reproduce.survey.row import survey_rows
from sonarmap.tools.lab.reproduce.survey.section import PICTURE, draw_paths, survey_section
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate
from sonarmap.tools.methods.registry import ALL_METHODS

DIVES = "dives"


@dataclass(frozen=True, slots=True)
class SurveySettings:
    """What is run.

    Attributes:
        scene: a key of SCENE_KINDS.
        seeds: how many surveys, each with a scene, a sea and a noise of its own, counted from `first_seed`.
        first_seed: >= 0.
        counts: of the scans of a survey; the peers map the longest alone.
        dive: scans of each of two dives over one place; 0 for none.
        unusable: share of the scans that show nothing of the scene.
        edge: voxels per edge; their size is chosen for the survey, as `sonarmap map` does.
        systems: of SYSTEMS.
        left_out: systems that would have run were their packages installed.
    """

    scene: str = "floodgate"
    seeds: int = 1
    first_seed: int = 5
    counts: tuple[int, ...] = (50, 100, 200)
    dive: int = 60
    unusable: float = 0.03
    edge: int = 128
    systems: tuple[str, ...] = SYSTEMS
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_scenes((self.scene,))
        check_seeds(self.seeds, self.first_seed)
        if not self.counts or min(self.counts) < 2 or self.dive < 0:
            raise InputError(f"{self.counts} scans and dives of {self.dive}; a survey needs 2 scans or more")


@dataclass(frozen=True, slots=True)
class SimulatedSurvey:
    """N scans, and what is true of them.

    Attributes:
        scans: one dive's after another's; their stamps count them from 0.
        truth: their poses; the world is the scene's frame, East-North-Up.
        dives: (N,) int, the number of the survey of each scan, as given to the mapper.
        unusable: the scans that show nothing of the scene.
        mesh: the scene's true surface [m, world].
    """

    scans: tuple[Scan, ...]
    truth: Trajectory
    dives: np.ndarray
    unusable: frozenset[int]
    mesh: Mesh


def simulate_survey(scene: str, seed: int, count: int, unusable: float, dives: Sequence[int] = (1,)) -> SimulatedSurvey:
    """Simulate `count` scans of each of the dives, in their order; their relative pose is given nowhere.

    Args:
        scene: a key of SCENE_KINDS.
        seed: of the scene, the waves and the noise.
        count: of the scans of a dive.
        unusable: share of these that show nothing of the scene.
        dives: as `tools.lab.simulate.paths.dive` counts them.
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


_ORDER = (2, 1)  # of the dives, as they are given to the mapper


class SurveyExperiment(Experiment):
    """Maps simulated surveys by this project's mapper and by others."""

    name: ClassVar[str] = "survey"
    sources: ClassVar[tuple[str, ...]] = (
        "slam",
        "tools/lab/simulate",
        "tools/lab/evaluate",
        "tools/products/output",
        *(f"tools/lab/reproduce/survey/{name}.py" for name in ("mapped", "row")),
        *ALL_METHODS,
    )

    def __init__(self, settings: SurveySettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        super().__init__(settings, device)
        self._survey = lru_cache(maxsize=1)(self._simulated)  # kept for the next system

    def jobs(self) -> Sequence[str]:
        """scene-seed/scans/system, and scene-seed/dives."""
        settings: SurveySettings = self.settings
        jobs = []
        for seed in range(settings.first_seed, settings.first_seed + settings.seeds):
            begin = f"{settings.scene}-{seed}"
            jobs += [
                f"{begin}/{count}/{system}"
                for count in settings.counts
                for system in settings.systems
                if system == OURS or count == max(settings.counts)
            ]
            jobs += [f"{begin}/{DIVES}"] if settings.dive else []
        return jobs

    def run(self, job: str) -> Outcome:
        """Simulate and map one survey.

        Raises:
            InputError: a system's package is not installed, or it cannot map the scans.
        """
        kind, _, system = job.rpartition("/")
        if system == DIVES:
            kind, system = job, OURS
        survey = self._survey(kind)
        grid = survey_grid(survey.scans, self.settings.edge)
        mapped = map_survey(system, survey.scans, survey.dives.tolist(), grid, self.device)
        begin = _named(kind) | {"system": system}
        rows = tuple({**begin, **row} for row in survey_rows(survey, mapped, grid.voxel))
        return Outcome(rows, (begin | _seconds(mapped.time, len(survey.scans)),))

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """Errors side by side, growth with the number of scans, and two dives."""
        return survey_section(rows, seconds, self.settings)

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """The paths on the longest survey of the first seed."""
        settings: SurveySettings = self.settings
        draw_paths(folder / PICTURE, rows, settings.scene, settings.first_seed, f"{max(settings.counts)}")

    def _simulated(self, kind: str) -> SimulatedSurvey:
        """The scans of a kind of job."""
        settings, named = self.settings, _named(kind)
        dives = _ORDER if named["survey"] == DIVES else (1,)
        count = settings.dive if named["survey"] == DIVES else int(named["survey"])
        return simulate_survey(settings.scene, int(named["seed"]), count, settings.unusable, dives)


def _named(kind: str) -> dict[str, Value]:
    """What a job is about: "survey" is the number of its scans, or DIVES."""
    place, survey = kind.split("/")
    scene, _, seed = place.rpartition("-")
    return {"scene": scene, "seed": int(seed), "survey": survey}


def _seconds(time: MappingTime, scans: int) -> dict[str, Value]:
    return {
        "scans": scans,
        "total_s": time.total,
        "per_scan_s": time.total / scans,
        "registering_s": time.registering,
        "signing_s": time.signing,
        "optimizing_s": time.optimizing,
        "fusing_s": time.fusing,
        "peak_memory_mib": time.memory / 2**20,
    }


def create(request: Request) -> SurveyExperiment:
    """The experiment as the command line asks for it; `quick` is twelve scans on half the voxels, without peers.

    Raises:
        InputError: an option's value will not do.
    """
    left_out = () if request.quick else tuple(system for system in PEERS if not installed(system))
    usual = SurveySettings(systems=tuple(name for name in SYSTEMS if name not in left_out), left_out=left_out)
    settings = as_asked(usual, request, counts=(12,), dive=0, edge=64, systems=(OURS,))
    return SurveyExperiment(settings, request.opened.selector)
