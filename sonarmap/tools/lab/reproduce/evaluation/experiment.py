"""What the experiments on pairs of the evaluation's set share: a job is a batch of pairs, registered by one method."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from sonarmap.tools.lab.reproduce.evaluation.answer import answer, claims, errors
from sonarmap.tools.lab.reproduce.evaluation.methods import registrar
from sonarmap.tools.lab.reproduce.evaluation.set_pairs import BATCH, SetPair
from sonarmap.tools.lab.reproduce.experiment import Outcome

SOURCES = ("tools/lab/simulate", "tools/lab/evaluate", "tools/lab/reproduce/evaluation", "spectral/grid.py")


class PairSetExperiment(ABC):
    """Registers batches of pairs; a job's key is a batch's, then a slash and a method."""

    sources: ClassVar[tuple[str, ...]] = SOURCES

    def __init__(self, settings: Any, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings = settings
        self.methods: tuple[str, ...] = settings.compared.methods
        self.deciding: Mapping[str, Any] = {"edge": settings.edge, "seed": settings.seed}
        self._device = device
        self._batch: tuple[str, list[SetPair]] | None = None

    @abstractmethod
    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair of a batch, by its number in the set; None where its scene has no such pair."""

    def run(self, job: str) -> Outcome:
        """Register a batch by one method."""
        batch, _, method = job.rpartition("/")
        rows = []
        for pair in self._pairs(batch):
            built = registrar(method, pair.grid, self._device, any_tilt=batch.startswith("any"))
            registration = answer(built, pair.target, pair.source)
            scored = {} if pair.truth is None else errors(registration, pair.truth, pair.grid.voxel)
            rows.append(pair.cells | {"method": method} | scored | claims(registration))
        return Outcome(tuple(rows))

    def _pairs(self, batch: str) -> list[SetPair]:
        """The pairs of a batch, kept for the next method."""
        if self._batch is None or self._batch[0] != batch:
            first = int(batch.rpartition("/")[2]) * BATCH
            pairs = [self.pair(batch, number) for number in range(first, first + BATCH)]
            self._batch = batch, [pair for pair in pairs if pair is not None]
        return self._batch[1]
