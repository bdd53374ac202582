"""Pairs of every overlap, any yaw or any rotation, by every method: what is right, what is accepted, how sure it is."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, cast

from sonarmap.tools.lab.reproduce.evaluation.experiment import PairSetExperiment
from sonarmap.tools.lab.reproduce.evaluation.methods import compared_methods
from sonarmap.tools.lab.reproduce.evaluation.set_pairs import BATCH, SetPair, related
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.pairs.figure import draw_pairs
from sonarmap.tools.lab.reproduce.pairs.section import pairs_section
from sonarmap.tools.lab.reproduce.pairs.settings import ANY_SHARE, PairsSettings
from sonarmap.tools.lab.reproduce.rows import all_rows
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn


class Pairs(PairSetExperiment):
    """Registers the pairs of a set; a job is five of them and one method."""

    name: ClassVar[str] = "pairs"

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

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """Success, trust and calibration."""
        return pairs_section(all_rows(outcomes), self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Success against overlap, and calibration."""
        draw_pairs(folder, all_rows(outcomes), self.methods)

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair of the batch's turn; those with the turn "any" are of the next set."""
        turn = cast(Turn, batch.partition("/")[0])
        return related(number, self.settings.seed + (turn == "any"), turn, self.settings.edge)


def create(request: Request) -> Pairs:
    """The experiment as the command line asks for it; `quick` is one batch of each turn on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    usual, quick = PairsSettings(), request.quick
    count = request.pairs or (BATCH if quick else usual.yaw)
    some = -(-count // ANY_SHARE)
    settings = PairsSettings(
        yaw=count,
        any=some,
        peers={"yaw": count, "any": some} if request.pairs else usual.peers,
        seed=usual.seed if request.seed is None else request.seed,
        edge=request.grid or (64 if quick else usual.edge),
        compared=compared_methods(request),
    )
    return Pairs(settings, request.opened.selector)
