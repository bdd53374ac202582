"""Surveys of thousands of scans: processor time and memory of the mapper, and whether the map stays right."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.rows import all_rows, all_seconds
from sonarmap.tools.lab.reproduce.scale.measured import measure
from sonarmap.tools.lab.reproduce.scale.section import scale_section
from sonarmap.tools.lab.reproduce.scale.settings import ScaleSettings


class Scale:
    """Maps made-up surveys of growing length; a job is one survey."""

    name: ClassVar[str] = "scale"
    sources: ClassVar[tuple[str, ...]] = ("slam", "tools/lab/evaluate")

    def __init__(self, settings: ScaleSettings) -> None:
        self.settings: Any = settings

    def jobs(self) -> Sequence[str]:
        """seed/scans."""
        settings: ScaleSettings = self.settings
        seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
        return [f"{seed}/{count}" for seed in seeds for count in settings.counts]

    def run(self, job: str) -> Outcome:
        """Map one survey."""
        seed, count = map(int, job.split("/"))
        measured = measure(count, seed, self.settings)
        return Outcome((measured.row,), measured.stages)

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """Poses, times and memory."""
        return scale_section(all_rows(outcomes), all_seconds(outcomes), self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Nothing: a picture of times would differ from run to run."""


def create(request: Request) -> Scale:
    """The experiment as the command line asks for it; `quick` is 100 and 200 scans of fewer points.

    Raises:
        InputError: an option's value will not do.
    """
    usual, quick = ScaleSettings(), request.quick
    return Scale(
        ScaleSettings(
            counts=(100, 200) if quick else usual.counts,
            points=4000 if quick else usual.points,
            seeds=request.seeds or usual.seeds,
            first_seed=usual.first_seed if request.seed is None else request.seed,
        )
    )
