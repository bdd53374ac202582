"""Surveys mapped again by each rule of the graph, from registrations that are kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.reproduce.decisions.section import decisions_section
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked, check_scenes, check_seeds
from sonarmap.tools.lab.reproduce.survey.mapped import mapped_of
from sonarmap.tools.lab.reproduce.survey.row import estimate_cells
from sonarmap.tools.lab.reproduce.survey.simulated import SimulatedSurvey, simulate_survey
from sonarmap.tools.lab.simulate.kinds.kind import ROUGH_SCENES
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.methods.registry import DEFAULT_METHOD, Setup, find_method

USUAL = "as usual"
# What is tried: other thresholds of the graph
RULES: Mapping[str, LoopSettings] = MappingProxyType(
    {
        USUAL: LoopSettings(),
        "answers agree within 3 sigmas": LoopSettings(bound=3.0),
        "one round of loops": LoopSettings(rounds=1, most_rounds=1),
        "without loops": LoopSettings(per_scan=0),
    }
)


@dataclass(frozen=True, slots=True)
class DecisionSettings:
    """What is run."""

    scenes: tuple[str, ...] = ROUGH_SCENES  # keys of SCENE_KINDS
    seeds: int = 5  # surveys of each scene, counted from `first_seed`
    first_seed: int = 7202  # >= 0
    scans: int = 24  # of each survey, by the usual sensor
    edge: int = 128  # voxels per edge; their size is chosen for the survey, as `sonarmap map` does

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_scenes(self.scenes)
        check_seeds(self.seeds, self.first_seed)
        if self.scans < 2:
            raise InputError(f"{self.scans} scans; a survey needs 2 or more")


class Decisions(Experiment):
    """Maps surveys by every rule; what has been registered before is taken from a folder's journals."""

    name = "decisions"
    sources: ClassVar[tuple[str, ...]] = (
        *("slam", "tools/lab/simulate", "tools/lab/evaluate"),
        *(f"tools/lab/reproduce/survey/{name}.py" for name in ("mapped", "row", "simulated")),
        *find_method(DEFAULT_METHOD).sources,
    )
    make_section = staticmethod(decisions_section)

    def __init__(self, folder: Path, settings: DecisionSettings, device: str | None) -> None:
        """The folder holds a journal of each survey, or gets it; the device is as `choose_device` takes it."""
        super().__init__(settings, device)
        self._folder = folder
        self._planned: SpectralRegistrar | None = None

    def jobs(self) -> Sequence[str]:
        """scene-seed."""
        settings: DecisionSettings = self.settings
        seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
        return [f"{scene}-{seed}" for seed in seeds for scene in settings.scenes]

    def run(self, job: str) -> Outcome:
        """Simulate one survey, and map it by every rule."""
        scene, _, seed = job.rpartition("-")
        survey = simulate_survey(scene, int(seed), self.settings.scans, 0.0)
        self._folder.mkdir(parents=True, exist_ok=True)
        with Journal(self._folder / f"{job}.sqlite") as journal:
            begin = {"scene": scene, "seed": int(seed)}
            return Outcome(tuple({"rule": rule, **begin, **self._row(survey, rule, journal)} for rule in RULES))

    def _row(self, survey: SimulatedSurvey, rule: str, journal: Journal) -> Row:
        setup = Setup(survey_grid(survey.scans, self.settings.edge), self.device)
        registrar = self._registrar(setup)
        key = method_key(DEFAULT_METHOD, setup, registrar)
        execution = Execution(Worker(registrar, prepared_limit(registrar)), journal=journal, method=key)
        settings = MapperSettings(loops=RULES[rule])
        result = Mapper(registrar, setup.grid.voxel, settings, execution).run(survey.scans)
        pairs = execution.timings.pairs
        return estimate_cells(survey, mapped_of(result), setup.grid.voxel) | {
            "odd": len(result.odd),
            "registered": sum(not pair.from_journal for pair in pairs),
        }

    def _registrar(self, setup: Setup) -> SpectralRegistrar:
        """Its tables are planned once."""
        if self._planned is None:
            self._planned = SpectralRegistrar(choose_device(setup.device), setup.grid)
        return self._planned.with_voxel(setup.grid.voxel)


def create(request: Request) -> Decisions:
    """The experiment as the command line asks for it; `quick` is six scans of a wreck on half the voxels."""
    settings = as_asked(DecisionSettings(), request, scenes=("wreck",), seeds=1, scans=6, edge=64)
    return Decisions(request.chosen_folder, settings, request.opened.selector)
