"""Pairs of every overlap, any yaw or any rotation, by every method: what succeeds, what is believed, how sure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, cast

from kernels.errors import InputError
from spectral.grid import Grid
from tools.reproduce.evaluation.answer import answer, claims, errors
from tools.reproduce.evaluation.lineup import OURS, Lineup, lineup, registrar
from tools.reproduce.evaluation.set_pairs import BATCH, SET_SEED, SetPair, batches, related
from tools.reproduce.experiment import Outcome, Section
from tools.reproduce.experiments import Request
from tools.reproduce.pairs.figure import draw_pairs
from tools.reproduce.pairs.section import pairs_section
from tools.simulate.pairs.turns import Turn

ANY_SHARE = 5  # for so many pairs with the turn "yaw" one with the turn "any"


@dataclass(frozen=True, slots=True)
class PairsSettings:
    """What is run.

    Attributes:
        yaw, any: how many pairs of each turn, rounded up to whole batches; those of "any" are others.
        peers: how many of each turn the methods beside ours register, as they take ten times as long: the first, which
            are as even a set as all.
        seed: of the set.
        edge: voxels per edge; their size is chosen for each pair.
        lineup: the methods.
    """

    yaw: int = 1000
    any: int = 1000 // ANY_SHARE
    peers: Mapping[Turn, int] = field(default_factory=lambda: MappingProxyType({"yaw": 300, "any": 300 // ANY_SHARE}))
    seed: int = SET_SEED
    edge: int = 128
    lineup: Lineup = field(default_factory=Lineup)

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        if self.yaw < 1 or self.any < 1 or self.seed < 0:
            raise InputError(f"{self.yaw} and {self.any} pairs of the set {self.seed}; wanted 1 or more, of one >= 0")

    @property
    def counts(self) -> dict[Turn, int]:
        """Pairs of each turn."""
        return {"yaw": batches(self.yaw) * BATCH, "any": batches(self.any) * BATCH}

    def registers(self, method: str, turn: Turn) -> int:
        """How many pairs of a turn a method registers."""
        count = self.counts[turn]
        return count if method == OURS else min(count, batches(self.peers[turn]) * BATCH)


class Pairs:
    """Registers the pairs of a set; a job is five of them and one method."""

    name: ClassVar[str] = "pairs"

    def __init__(self, settings: PairsSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self.methods = settings.lineup.methods
        self.deciding: Mapping[str, Any] = {"edge": settings.edge, "seed": settings.seed}
        self._device = device
        self._batch: tuple[str, list[SetPair]] | None = None

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

    def run(self, job: str) -> Outcome:
        """Register a batch by one method."""
        batch, _, method = job.rpartition("/")
        rows = []
        for pair in self._pairs(batch):
            assert pair.truth is not None
            found = answer(
                registrar(method, pair.grid, self._device, batch.startswith("any")), pair.target, pair.source
            )
            judged = errors(found, pair.truth, pair.grid.voxel)
            rows.append(pair.cells | {"method": method} | judged | claims(found))
        return Outcome(tuple(rows))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """Success, trust and calibration."""
        return pairs_section([row for one in outcomes.values() for row in one.rows], self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Success against overlap, and calibration."""
        draw_pairs(folder, [row for one in outcomes.values() for row in one.rows], self.methods)

    def _pairs(self, batch: str) -> list[SetPair]:
        """Kept for the methods to come. The pairs with the turn "any" are of the next set."""
        if self._batch is None or self._batch[0] != batch:
            turn, number = batch.split("/")
            seed = self.settings.seed + (turn == "any")
            numbers = range(int(number) * BATCH, (int(number) + 1) * BATCH)
            found = [related(n, seed, cast(Turn, turn), self.settings.edge) for n in numbers]
            self._batch = batch, [pair for pair in found if pair is not None]
        return self._batch[1]


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
        lineup=lineup(request),
    )
    return Pairs(settings, request.opened.selector)
