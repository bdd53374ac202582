"""Surveys mapped again by each rule of the graph, from registrations that a folder keeps: what a rule is worth."""

from collections.abc import Mapping
from types import MappingProxyType

from sonarmap.kernels.device.device import choose_device
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, all_seeds
from sonarmap.tools.lab.reproduce.experiments import Request, as_asked
from sonarmap.tools.lab.reproduce.survey_mapped import mapped_of
from sonarmap.tools.lab.reproduce.survey_rows import SimulatedSurvey, estimate_cells, simulate_survey
from sonarmap.tools.lab.simulate.kinds.kind import ROUGH_SCENES
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.methods.registry import DEFAULT_METHOD, Setup, find_method

# Surveys of each scene, and their scans by the usual sensor; voxels per edge, whose size is chosen for the survey
_USUAL = {"scenes": ROUGH_SCENES, "seeds": 5, "first_seed": 7202, "scans": 24, "edge": 128}
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
SOURCES = (
    *("slam", "tools/lab/simulate", "tools/lab/evaluate", *find_method(DEFAULT_METHOD).sources),
    *(f"tools/lab/reproduce/{name}.py" for name in ("experiment", "decisions", "survey_mapped", "survey_rows")),
)


def create(request: Request) -> Experiment:
    """A job is a survey by every rule, as in wreck-7202; the folder holds a journal of each survey, or gets it.

    `quick` is six scans of a wreck on half the voxels.
    """
    settings = as_asked(request, _USUAL, {"scenes": ("wreck",), "seeds": 1, "scans": 6, "edge": 64})
    folder, planned = request.chosen_folder, list[SpectralRegistrar]()

    def row(survey: SimulatedSurvey, rule: str, journal: Journal) -> Row:
        setup = Setup(survey_grid(survey.scans, settings.edge), request.opened.selector)
        if not planned:  # its tables are planned once
            planned.append(SpectralRegistrar(choose_device(setup.device), setup.grid))
        registrar = planned[0].with_voxel(setup.grid.voxel)
        key = method_key(DEFAULT_METHOD, setup, registrar)
        execution = Execution(Worker(registrar, prepared_limit(registrar)), journal=journal, method=key)
        mapper = Mapper(registrar, setup.grid.voxel, MapperSettings(loops=RULES[rule]), execution)
        result = mapper.run(survey.scans)
        registered = sum(not pair.from_journal for pair in execution.timings.pairs)
        cells = estimate_cells(survey, mapped_of(result), setup.grid.voxel)
        return cells | {"odd": len(result.odd), "registered": registered}

    def run(job: str) -> Outcome:
        scene, _, seed = job.rpartition("-")
        survey = simulate_survey(scene, int(seed), settings.scans, 0.0)
        folder.mkdir(parents=True, exist_ok=True)
        with Journal(folder / f"{job}.sqlite") as journal:
            begin = {"scene": scene, "seed": int(seed)}
            return Outcome(tuple({"rule": rule, **begin, **row(survey, rule, journal)} for rule in RULES))

    jobs = [f"{scene}-{seed}" for seed in all_seeds(settings) for scene in settings.scenes]
    return Experiment("decisions", settings, jobs, run, SOURCES)
