"""Surveys of thousands of scans: processor time and memory of the mapper, and whether the map stays right."""

from collections.abc import Sequence
from typing import ClassVar

from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.scale.measured import ScaleSettings, measure
from sonarmap.tools.lab.reproduce.scale.section import scale_section
from sonarmap.tools.lab.reproduce.settings import as_asked


class Scale(Experiment):
    """Maps made-up surveys of growing length; a job is one survey."""

    name: ClassVar[str] = "scale"
    sources: ClassVar[tuple[str, ...]] = ("slam", "tools/lab/evaluate", "tools/lab/reproduce/scale")

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

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """Poses, times and memory."""
        return scale_section(rows, seconds, self.settings)


def create(request: Request) -> Scale:
    """The experiment as the command line asks for it; `quick` is 100 and 200 scans of fewer points."""
    return Scale(as_asked(ScaleSettings(), request, counts=(100, 200), points=4000))
