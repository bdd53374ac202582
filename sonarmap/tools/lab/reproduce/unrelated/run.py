"""Pairs that share nothing, by every method: none may be accepted."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from sonarmap.tools.lab.reproduce.evaluation.experiment import PairSetExperiment
from sonarmap.tools.lab.reproduce.evaluation.set_pairs import BATCH, SetPair, batches, unrelated
from sonarmap.tools.lab.reproduce.evaluation.settings import pair_set_settings
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.rows import all_rows
from sonarmap.tools.lab.reproduce.unrelated.figure import draw_unrelated
from sonarmap.tools.lab.reproduce.unrelated.section import PICTURE, unrelated_section

PAIRS = 500


class Unrelated(PairSetExperiment):
    """Registers pairs of strangers; a job is five of them and one method."""

    name: ClassVar[str] = "unrelated"

    def jobs(self) -> Sequence[str]:
        """Batch and method, as in 003/spectral."""
        return [f"{k:03d}/{method}" for k in range(batches(self.settings.pairs)) for method in self.methods]

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """What is accepted."""
        return unrelated_section(all_rows(outcomes), self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """How the registrations' own marks are distributed."""
        draw_unrelated(folder / PICTURE, all_rows(outcomes))

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair that shares nothing."""
        return unrelated(number, self.settings.seed, self.settings.edge)


def create(request: Request) -> Unrelated:
    """The experiment as the command line asks for it; `quick` is one batch on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    return Unrelated(pair_set_settings(request, PAIRS, quick_pairs=BATCH), request.opened.selector)
