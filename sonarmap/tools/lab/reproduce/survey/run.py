"""Whole surveys, mapped: how far off poses and maps are, what became of right and wrong pairs, and what it takes."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import ClassVar

from sonarmap.slam.survey_grid import survey_grid
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.survey.mapped import OURS, PEERS, STAGES, SYSTEMS, installed, map_survey
from sonarmap.tools.lab.reproduce.survey.row import survey_rows
from sonarmap.tools.lab.reproduce.survey.section import draw_paths, survey_section
from sonarmap.tools.lab.reproduce.survey.simulated import DIVES, SimulatedSurvey, SurveySettings, simulate_survey
from sonarmap.tools.methods.registry import ALL_METHODS

_ORDER = (2, 1)  # of the dives, as they are given to the mapper


class SurveyExperiment(Experiment):
    """Maps simulated surveys by this project's mapper and by others."""

    name = "survey"
    sources: ClassVar[tuple[str, ...]] = (
        *("slam", "tools/lab/simulate", "tools/lab/evaluate", "tools/products/output"),
        *(f"tools/lab/reproduce/survey/{name}.py" for name in ("mapped", "row", "simulated")),
        *ALL_METHODS,
    )
    make_section, draw_pictures = staticmethod(survey_section), staticmethod(draw_paths)

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
        """Simulate and map one survey."""
        kind, _, system = job.rpartition("/")
        if system == DIVES:
            kind, system = job, OURS
        survey = self._survey(kind)
        grid = survey_grid(survey.scans, self.settings.edge)
        mapped = map_survey(system, survey.scans, survey.dives.tolist(), grid, self.device)
        begin = _named(kind) | {"system": system}
        rows = tuple({**begin, **row} for row in survey_rows(survey, mapped, grid.voxel))
        return Outcome(rows, (begin | _seconds(mapped.took, len(survey.scans)),))

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


def _seconds(took: Mapping[str, float], scans: int) -> dict[str, Value]:
    """NaN for what a system does not tell."""
    total, *parts = (took.get(stage, float("nan")) for stage in STAGES)
    times = {f"{stage}_s": seconds for stage, seconds in zip(STAGES[1:], parts, strict=True)}
    memory = took["memory"] / 2**20
    return {"scans": scans, "total_s": total, "per_scan_s": total / scans, **times, "peak_memory_mib": memory}


def create(request: Request) -> SurveyExperiment:
    """The experiment as the command line asks for it; `quick` is twelve scans on half the voxels, without peers."""
    left_out = () if request.quick else tuple(system for system in PEERS if not installed(system))
    usual = SurveySettings(systems=tuple(name for name in SYSTEMS if name not in left_out), left_out=left_out)
    settings = as_asked(usual, request, counts=(12,), dive=0, edge=64, systems=(OURS,))
    return SurveyExperiment(settings, request.opened.selector)
