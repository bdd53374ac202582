"""Pairs of every overlap, any yaw or any rotation, by every method: what is right, what is accepted, how sure it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, cast

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.evaluation.pair_set import (
    BATCH,
    SET_SEED,
    PairSetExperiment,
    SetPair,
    batches,
    related,
)
from sonarmap.tools.lab.reproduce.evaluation.pairs_figure import draw_pairs
from sonarmap.tools.lab.reproduce.evaluation.pairs_section import pairs_section
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import OURS, ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.pairs.turns import Turn

ANY_SHARE = 5  # for so many pairs with the turn "yaw" one with the turn "any"


@dataclass(frozen=True, slots=True)
class PairsSettings:
    """What is run.

    Attributes:
        yaw, any: how many pairs of each turn, rounded up to whole batches; those of "any" are others.
        peers: how many pairs of each turn, from the first, the methods other than ours register, as they take ten times
            as long; they are spread over the overlaps as evenly as the whole set.
        seed: of the set.
        edge: voxels per edge; their size is chosen for each pair.
        compared: the methods.
    """

    yaw: int = 1000
    any: int = 1000 // ANY_SHARE
    peers: Mapping[Turn, int] = field(default_factory=lambda: MappingProxyType({"yaw": 300, "any": 300 // ANY_SHARE}))
    seed: int = SET_SEED
    edge: int = 128
    compared: ComparedMethods = field(default_factory=ComparedMethods)

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        if self.yaw < 1 or self.any < 1 or self.seed < 0:
            raise InputError(
                f"{self.yaw} and {self.any} pairs of the set {self.seed}; each must be 1 or more, and the seed >= 0"
            )

    @property
    def counts(self) -> dict[Turn, int]:
        """Pairs of each turn."""
        return {"yaw": batches(self.yaw) * BATCH, "any": batches(self.any) * BATCH}

    def registers(self, method: str, turn: Turn) -> int:
        """How many pairs of a turn a method registers."""
        count = self.counts[turn]
        return count if method == OURS else min(count, batches(self.peers[turn]) * BATCH)


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

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """Success, trust and calibration."""
        return pairs_section(rows, self.settings)

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """Success against overlap, and calibration."""
        draw_pairs(folder, rows, self.methods)

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair of the batch's turn; those with the turn "any" are of the next set."""
        turn = cast(Turn, batch.partition("/")[0])
        return related(number, self.settings.seed + (turn == "any"), turn, self.settings.edge)


def create(request: Request) -> Pairs:
    """The experiment as the command line asks for it; `quick` is one batch of each turn on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    usual = PairsSettings(compared=compared_methods(request))
    if request.pairs or request.quick:
        count = request.pairs or BATCH
        some = -(-count // ANY_SHARE)
        usual = replace(usual, yaw=count, any=some)
        usual = replace(usual, peers={"yaw": count, "any": some}) if request.pairs else usual
    return Pairs(as_asked(usual, request, edge=64), request.opened.selector)
