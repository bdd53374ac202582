"""Pairs that share nothing, by every method: none may be accepted."""

from collections.abc import Sequence

from sonarmap.tools.lab.reproduce.evaluation.pair_set import PairSetExperiment, SetPair, unrelated
from sonarmap.tools.lab.reproduce.evaluation.settings import BATCH, batches, pair_set_settings
from sonarmap.tools.lab.reproduce.evaluation.unrelated_section import draw_unrelated, unrelated_section
from sonarmap.tools.lab.reproduce.experiments import Request

PAIRS = 500


class Unrelated(PairSetExperiment):
    """Registers pairs of strangers; a job is five of them and one method."""

    name = "unrelated"
    make_section, draw_pictures = staticmethod(unrelated_section), staticmethod(draw_unrelated)

    def jobs(self) -> Sequence[str]:
        """Batch and method, as in 003/spectral."""
        return [f"{k:03d}/{method}" for k in range(batches(self.settings.pairs)) for method in self.methods]

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair that shares nothing."""
        return unrelated(number, self.settings.seed, self.settings.edge)


def create(request: Request) -> Unrelated:
    """The experiment as the command line asks for it; `quick` is one batch on half the voxels."""
    return Unrelated(pair_set_settings(request, PAIRS, quick_pairs=BATCH), request.opened.selector)
