"""Whole surveys, mapped: how far off poses and maps are, what became of right and wrong pairs, and what it takes."""

from collections.abc import Mapping
from functools import lru_cache

from sonarmap.slam.survey_grid import survey_grid
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Value, all_seeds
from sonarmap.tools.lab.reproduce.experiments import Request, as_asked
from sonarmap.tools.lab.reproduce.survey_mapped import OURS, PEERS, STAGES, SYSTEMS, installed, map_survey
from sonarmap.tools.lab.reproduce.survey_rows import SimulatedSurvey, simulate_survey, survey_rows
from sonarmap.tools.methods.registry import ALL_METHODS

DIVES = "dives"
# A survey of each number of scans, and two dives of so many scans over one place (0 for none); a share of the scans
# shows nothing of the scene; voxels per edge, whose size is chosen for the survey, as `sonarmap map` does
_USUAL = {"scene": "floodgate", "seeds": 1, "first_seed": 5, "counts": (50, 100, 200), "dive": 60}
_USUAL |= {"unusable": 0.03, "edge": 128}
_ORDER = (2, 1)  # of the dives, as they are given to the mapper
SOURCES = (
    *("slam", "tools/lab/simulate", "tools/lab/evaluate", "tools/products/output", *ALL_METHODS),
    *(f"tools/lab/reproduce/{name}.py" for name in ("experiment", "survey", "survey_mapped", "survey_rows")),
)


def create(request: Request) -> Experiment:
    """A job is a survey by one system, as in floodgate-5/200/sonarmap, or two dives, as in floodgate-5/dives; other
    systems map the longest survey alone. `quick` is twelve scans on half the voxels, without other systems."""
    left_out = () if request.quick else tuple(system for system in PEERS if not installed(system))
    systems = {"systems": tuple(name for name in SYSTEMS if name not in left_out), "left_out": left_out}
    quick = {"counts": (12,), "dive": 0, "edge": 64, "systems": (OURS,)}
    settings = as_asked(request, _USUAL | systems, quick)

    @lru_cache(maxsize=1)
    def survey_of(kind: str) -> SimulatedSurvey:
        """The scans of a kind of job, kept for the next system."""
        named = _named(kind)
        dives = _ORDER if named["survey"] == DIVES else (1,)
        count = settings.dive if named["survey"] == DIVES else int(named["survey"])
        return simulate_survey(settings.scene, int(named["seed"]), count, settings.unusable, dives)

    def run(job: str) -> Outcome:
        kind, _, system = job.rpartition("/")
        if system == DIVES:
            kind, system = job, OURS
        survey = survey_of(kind)
        grid = survey_grid(survey.scans, settings.edge)
        mapped = map_survey(system, survey.scans, survey.dives.tolist(), grid, request.opened.selector)
        begin = _named(kind) | {"system": system}
        rows = tuple({**begin, **row} for row in survey_rows(survey, mapped, grid.voxel))
        return Outcome(rows, (begin | _seconds(mapped.took, len(survey.scans)),))

    jobs = []
    for seed in all_seeds(settings):
        begin, longest = f"{settings.scene}-{seed}", max(settings.counts)
        for count in settings.counts:
            jobs += [f"{begin}/{count}/{each}" for each in settings.systems if each == OURS or count == longest]
        jobs += [f"{begin}/{DIVES}"] if settings.dive else []
    return Experiment("survey", settings, jobs, run, SOURCES)


def _named(kind: str) -> dict[str, Value]:
    """What a job is about: "survey" is the number of its scans, or DIVES."""
    place, survey = kind.split("/")
    scene, _, seed = place.rpartition("-")
    return {"scene": scene, "seed": int(seed), "survey": survey}


def _seconds(took: Mapping[str, float], scans: int) -> dict[str, Value]:
    """NaN for what a system does not tell."""
    total, *parts = (took.get(stage, float("nan")) for stage in STAGES)
    times = {f"{stage}_s": seconds for stage, seconds in zip(STAGES[1:], parts, strict=True)}
    memory = took["memory"] / 2**20
    return {"scans": scans, "total_s": total, "per_scan_s": total / scans, **times, "peak_memory_mib": memory}
