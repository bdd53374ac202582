"""Whole surveys, mapped: how far off poses and maps are, what became of right and wrong pairs, and what it takes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from sonarmap.slam.survey_grid import survey_grid
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.rows import all_rows, all_seconds
from sonarmap.tools.lab.reproduce.survey.figure import draw_ways
from sonarmap.tools.lab.reproduce.survey.mapped import OURS, PEERS, SYSTEMS, MappingTime, installed, map_survey
from sonarmap.tools.lab.reproduce.survey.row import survey_rows
from sonarmap.tools.lab.reproduce.survey.section import PICTURE, survey_section
from sonarmap.tools.lab.reproduce.survey.settings import DIVES, SurveySettings
from sonarmap.tools.lab.reproduce.survey.simulated import SimulatedSurvey, simulate_survey
from sonarmap.tools.methods.registry import ALL_METHODS

_ORDER = (2, 1)  # of the dives, as they are given to the mapper


class SurveyExperiment:
    """Maps simulated surveys by this project's mapper and by others."""

    name: ClassVar[str] = "survey"
    sources: ClassVar[tuple[str, ...]] = (
        "slam",
        "tools/lab/simulate",
        "tools/lab/evaluate",
        "tools/products/output",
        *ALL_METHODS,
    )

    def __init__(self, settings: SurveySettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self._device = device
        self._simulated: tuple[str, SimulatedSurvey] | None = None

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
        mapped = map_survey(system, survey.scans, survey.dives.tolist(), grid, self._device)
        begin = _named(kind) | {"system": system}
        rows = tuple({**begin, **row} for row in survey_rows(survey, mapped, grid.voxel))
        return Outcome(rows, (begin | _seconds(mapped.time, len(survey.scans)),))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """Errors side by side, growth with the number of scans, and two dives."""
        rows = all_rows(outcomes)
        return survey_section(rows, all_seconds(outcomes), self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The ways found on the longest survey of the first seed."""
        settings: SurveySettings = self.settings
        rows = all_rows(outcomes)
        draw_ways(folder / PICTURE, rows, settings.scene, settings.first_seed, f"{max(settings.counts)}")

    def _survey(self, kind: str) -> SimulatedSurvey:
        """The scans of a kind of job; kept for the next system."""
        if self._simulated is None or self._simulated[0] != kind:
            settings: SurveySettings = self.settings
            named = _named(kind)
            dives = _ORDER if named["survey"] == DIVES else (1,)
            count = settings.dive if named["survey"] == DIVES else int(named["survey"])
            self._simulated = kind, simulate_survey(settings.scene, int(named["seed"]), count, settings.unusable, dives)
        return self._simulated[1]


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
    usual, quick = SurveySettings(), request.quick
    left_out = () if quick else tuple(system for system in PEERS if not installed(system))
    settings = SurveySettings(
        scene=request.scene or usual.scene,
        seeds=request.seeds or usual.seeds,
        first_seed=usual.first_seed if request.seed is None else request.seed,
        counts=(12,) if quick else usual.counts,
        dive=0 if quick else usual.dive,
        edge=request.grid or (64 if quick else usual.edge),
        systems=(OURS,) if quick else tuple(system for system in SYSTEMS if system not in left_out),
        left_out=left_out,
    )
    return SurveyExperiment(settings, request.opened.selector)
