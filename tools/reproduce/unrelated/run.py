"""Pairs that share nothing, by every method: none may be believed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from kernels.errors import InputError
from spectral.grid import Grid
from tools.reproduce.evaluation.answer import answer, claims
from tools.reproduce.evaluation.lineup import Lineup, lineup, registrar
from tools.reproduce.evaluation.set_pairs import BATCH, SET_SEED, SetPair, batches, unrelated
from tools.reproduce.experiment import Outcome, Section
from tools.reproduce.experiments import Request
from tools.reproduce.unrelated.figure import draw_unrelated
from tools.reproduce.unrelated.section import PICTURE, unrelated_section


@dataclass(frozen=True, slots=True)
class UnrelatedSettings:
    """What is run.

    Attributes:
        pairs: how many, rounded up to whole batches.
        seed: of the set.
        edge: voxels per edge; their size is chosen for each pair.
        lineup: the methods.
    """

    pairs: int = 500
    seed: int = SET_SEED
    edge: int = 128
    lineup: Lineup = field(default_factory=Lineup)

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        if self.pairs < 1 or self.seed < 0:
            raise InputError(f"{self.pairs} pairs of the set {self.seed}; wanted 1 or more, of one >= 0")


class Unrelated:
    """Registers pairs of strangers; a job is five of them and one method."""

    name: ClassVar[str] = "unrelated"

    def __init__(self, settings: UnrelatedSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self.methods = settings.lineup.methods
        self.deciding: Mapping[str, Any] = {"edge": settings.edge, "seed": settings.seed}
        self._device = device
        self._batch: tuple[str, list[SetPair]] | None = None

    def jobs(self) -> Sequence[str]:
        """Batch and method, as in 003/spectral."""
        return [f"{k:03d}/{method}" for k in range(batches(self.settings.pairs)) for method in self.methods]

    def run(self, job: str) -> Outcome:
        """Register a batch by one method."""
        batch, method = job.split("/")
        rows = []
        for pair in self._pairs(batch):
            found = answer(registrar(method, pair.grid, self._device), pair.target, pair.source)
            rows.append(pair.cells | {"method": method} | claims(found))
        return Outcome(tuple(rows))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """What is believed."""
        return unrelated_section([row for one in outcomes.values() for row in one.rows], self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """How the answers' own marks are distributed."""
        draw_unrelated(folder / PICTURE, [row for one in outcomes.values() for row in one.rows])

    def _pairs(self, batch: str) -> list[SetPair]:
        """Kept for the methods to come."""
        if self._batch is None or self._batch[0] != batch:
            numbers = range(int(batch) * BATCH, (int(batch) + 1) * BATCH)
            found = [unrelated(n, self.settings.seed, self.settings.edge) for n in numbers]
            self._batch = batch, [pair for pair in found if pair is not None]
        return self._batch[1]


def create(request: Request) -> Unrelated:
    """The experiment as the command line asks for it; `quick` is one batch on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    usual, quick = UnrelatedSettings(), request.quick
    settings = UnrelatedSettings(
        pairs=request.pairs or (BATCH if quick else usual.pairs),
        seed=usual.seed if request.seed is None else request.seed,
        edge=request.grid or (64 if quick else usual.edge),
        lineup=lineup(request),
    )
    return Unrelated(settings, request.opened.selector)
