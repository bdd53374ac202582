"""Maps of whole surveys: errors of poses and maps, right and wrong pairs, time and memory.

`create_decisions` maps surveys with other thresholds of the graph, from registrations that a folder keeps.
"""

from collections.abc import Mapping

from sonarmap.kernels.device.device import choose_device
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, Value, all_seeds, as_asked
from sonarmap.tools.lab.reproduce.survey_mapped import map_survey, mapped_of
from sonarmap.tools.lab.reproduce.survey_rows import SimulatedSurvey, estimate_cells, simulate_survey, survey_cells
from sonarmap.tools.lab.simulate.kinds.kind import ROUGH_SCENES
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.methods.registry import ALL_METHODS, DEFAULT_METHOD, Setup, find_method

DIVES = "dives"
_USUAL = {
    "scene": "floodgate",
    "seeds": 1,
    "first_seed": 5,
    "counts": (50, 100, 200),  # scans of each survey
    "dive": 60,  # scans of each of two dives over one place; 0 for none
    "unusable": 0.03,  # share of the scans without echoes of the scene
    "edge": 128,  # voxels per edge; the voxel fits the survey
}
_ORDER = (2, 1)  # in which the mapper gets the dives
_MAPPING = (
    *("slam", "tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("survey", "survey_mapped", "survey_rows")),
)
SOURCES = (*_MAPPING, "tools/products/output", *ALL_METHODS)


def create(request: Request) -> Experiment:
    """A job is a survey, as floodgate-5/200, or two dives, as floodgate-5/dives. `quick` maps twelve scans on a grid of
    half the edge."""
    settings = as_asked(request, _USUAL, {"counts": (12,), "dive": 0, "edge": 64})

    def run(job: str) -> Outcome:
        labels = _named(job)
        dives = _ORDER if labels["survey"] == DIVES else (1,)
        count = settings.dive if labels["survey"] == DIVES else int(labels["survey"])
        survey = simulate_survey(settings.scene, int(labels["seed"]), count, settings.unusable, dives)
        scans, grid = len(survey.scans), survey_grid(survey.scans, settings.edge)
        mapped = map_survey(survey.scans, survey.dives.tolist(), grid, request.opened.selector)
        times: dict[str, Value] = {"scans": scans, "total_s": mapped.seconds, "per_scan_s": mapped.seconds / scans}
        times |= {"peak_memory_mib": mapped.memory / 2**20}
        return Outcome((labels | survey_cells(survey, mapped, grid.voxel),), (labels | times,))

    surveys = [*settings.counts, *([DIVES] if settings.dive else [])]
    jobs = [f"{settings.scene}-{seed}/{survey}" for seed in all_seeds(settings) for survey in surveys]
    return Experiment("survey", settings, jobs, run, SOURCES)


def _named(job: str) -> dict[str, Value]:
    """Cells that identify a job; "survey" is the number of its scans, or DIVES."""
    place, survey = job.split("/")
    scene, _, seed = place.rpartition("-")
    return {"scene": scene, "seed": int(seed), "survey": survey}


_DECISIONS = {"scenes": ROUGH_SCENES, "seeds": 5, "first_seed": 7202, "scans": 24, "edge": 128}
USUAL = "as usual"  # the rule of the default settings
RULES: Mapping[str, LoopSettings] = {
    USUAL: LoopSettings(),
    "answers agree within 3 sigmas": LoopSettings(bound=3.0),
    "one round of loops": LoopSettings(rounds=1, most_rounds=1),
    "without loops": LoopSettings(per_scan=0),
}
_DECISIONS_SOURCES = (*_MAPPING, *find_method(DEFAULT_METHOD).sources)


def create_decisions(request: Request) -> Experiment:
    """A job is a survey by every rule, as wreck-7202; its journal is read from the folder, or created there.

    `quick` maps six scans of a wreck on a grid of half the edge.
    """
    settings = as_asked(request, _DECISIONS, {"scenes": ("wreck",), "seeds": 1, "scans": 6, "edge": 64})
    folder, planned = request.chosen_folder, list[SpectralRegistrar]()

    def row(survey: SimulatedSurvey, rule: str, journal: Journal) -> Row:
        setup = Setup(survey_grid(survey.scans, settings.edge), request.opened.selector)
        if not planned:  # the registrar's tables are computed once
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
            labels = {"scene": scene, "seed": int(seed)}
            return Outcome(tuple({"rule": rule, **labels, **row(survey, rule, journal)} for rule in RULES))

    jobs = [f"{scene}-{seed}" for seed in all_seeds(settings) for scene in settings.scenes]
    return Experiment("decisions", settings, jobs, run, _DECISIONS_SOURCES)
