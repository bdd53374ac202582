"""Whole surveys, mapped: how far off poses and maps are, what became of right and wrong pairs, and what it takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from kernels.errors import InputError
from spectral.grid import Grid, choose_grid
from tools.reproduce.experiment import Outcome, Section, Value
from tools.reproduce.experiments import Request
from tools.reproduce.survey.figure import draw_ways
from tools.reproduce.survey.map import OURS, PEERS, SYSTEMS, Took, installed, map_survey
from tools.reproduce.survey.row import survey_rows
from tools.reproduce.survey.scans import Laid, lay
from tools.reproduce.survey.section import PICTURE, survey_section
from tools.simulate.scenes.catalog import SCENE_KINDS

DIVES = "dives"
_ORDER = (2, 1)  # of the dives, as they are given to the mapper


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
        if self.scene not in SCENE_KINDS:
            raise InputError(f"no scene is called {self.scene!r}; there are {', '.join(SCENE_KINDS)}")
        if self.seeds < 1 or self.first_seed < 0:
            raise InputError(f"{self.seeds} seeds from {self.first_seed} on; wanted at least one, and none below 0")
        if not self.counts or min(self.counts) < 2 or self.dive < 0:
            raise InputError(f"{self.counts} scans and dives of {self.dive}; wanted surveys of 2 or more")


class Survey:
    """Maps simulated surveys by this project's mapper and by others."""

    name: ClassVar[str] = "survey"

    def __init__(self, settings: SurveySettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self._device = device
        self._laid: tuple[str, Laid] | None = None

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
        laid = self._survey(kind)
        grid = choose_grid(laid.scans, self.settings.edge)
        mapped = map_survey(system, laid.scans, laid.dives.tolist(), grid, self._device)
        begin = _named(kind) | {"system": system}
        rows = tuple({**begin, **row} for row in survey_rows(laid, mapped, grid.voxel))
        return Outcome(rows, (begin | _seconds(mapped.took, len(laid.scans)),))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """Errors side by side, growth with the number of scans, and two dives."""
        rows = [row for one in outcomes.values() for row in one.rows]
        return survey_section(rows, [row for one in outcomes.values() for row in one.seconds], self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The ways found on the longest survey of the first seed."""
        settings: SurveySettings = self.settings
        rows = [row for one in outcomes.values() for row in one.rows]
        draw_ways(folder / PICTURE, rows, settings.scene, settings.first_seed, f"{max(settings.counts)}")

    def _survey(self, kind: str) -> Laid:
        """The scans of a kind of job; kept for the next system."""
        if self._laid is None or self._laid[0] != kind:
            settings: SurveySettings = self.settings
            named = _named(kind)
            dives = _ORDER if named["survey"] == DIVES else (1,)
            count = settings.dive if named["survey"] == DIVES else int(named["survey"])
            self._laid = kind, lay(settings.scene, int(named["seed"]), count, settings.unusable, dives)
        return self._laid[1]


def _named(kind: str) -> dict[str, Value]:
    """What a job is about: "survey" is the number of its scans, or DIVES."""
    place, survey = kind.split("/")
    scene, _, seed = place.rpartition("-")
    return {"scene": scene, "seed": int(seed), "survey": survey}


def _seconds(took: Took, scans: int) -> dict[str, Value]:
    return {
        "scans": scans,
        "total_s": took.total,
        "per_scan_s": took.total / scans,
        "registering_s": took.registering,
        "signing_s": took.signing,
        "optimizing_s": took.optimizing,
        "fusing_s": took.fusing,
        "peak_memory_mib": took.memory / 2**20,
    }


def create(request: Request) -> Survey:
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
    return Survey(settings, request.opened.selector)
