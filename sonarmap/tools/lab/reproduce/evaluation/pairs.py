"""Pairs of every overlap, any yaw or any rotation, by every method: what is right, what is accepted, how sure it is."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from sonarmap.tools.lab.reproduce.evaluation.pair_set import PairSetExperiment, SetPair, related
from sonarmap.tools.lab.reproduce.evaluation.pairs_section import draw_pairs, pairs_section
from sonarmap.tools.lab.reproduce.evaluation.settings import ANY_SHARE, BATCH, PairsSettings
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import compared_methods
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn


class Pairs(PairSetExperiment):
    """Registers the pairs of a set; a job is five of them and one method."""

    name = "pairs"
    make_section, draw_pictures = staticmethod(pairs_section), staticmethod(draw_pairs)

    def jobs(self) -> Sequence[str]:
        """Turn, batch and method, as in yaw/003/spectral."""
        settings: PairsSettings = self.settings
        return [
            f"{turn}/{k:03d}/{method}"
            for turn, count in settings.counts.items()
            for k in range(count // BATCH)
            for method in self.methods
            if k < settings.registers(method, turn) // BATCH
        ]

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair of the batch's turn; those with the turn "any" are of the next set."""
        turn = cast(Turn, batch.partition("/")[0])
        return related(number, self.settings.seed + (turn == "any"), turn, self.settings.edge)


def create(request: Request) -> Pairs:
    """The experiment as the command line asks for it; `quick` is one batch of each turn on half the voxels."""
    usual = PairsSettings(compared=compared_methods(request))
    if request.pairs or request.quick:
        count = request.pairs or BATCH
        some = -(-count // ANY_SHARE)
        usual = replace(usual, yaw=count, any=some)
        usual = replace(usual, peers={"yaw": count, "any": some}) if request.pairs else usual
    return Pairs(as_asked(usual, request, edge=64), request.opened.selector)
