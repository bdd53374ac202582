"""How long a pair takes, by every method: the same pairs, in turn, in one process."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, ClassVar

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.tools.lab.reproduce.answer import errors, finish_device
from sonarmap.tools.lab.reproduce.evaluation.pair_set import SOURCES, SetPair, related
from sonarmap.tools.lab.reproduce.evaluation.settings import BATCH, pair_set_settings
from sonarmap.tools.lab.reproduce.evaluation.speed_section import speed_section
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import registrar
from sonarmap.tools.methods.registry import ALL_METHODS

ROUNDS = 3  # of each pair, of which the fastest counts
_LEAST = 1  # so many of each five pairs share too little: 5 to 20 %


PAIRS = 60


class Speed(Experiment):
    """Times every method on pairs with the turn "yaw" that share more than a fifth; a job is one pair."""

    name: ClassVar[str] = "speed"
    sources: ClassVar[tuple[str, ...]] = (*SOURCES, *ALL_METHODS)

    def jobs(self) -> Sequence[str]:
        """The pairs' numbers in the set."""
        good = BATCH - _LEAST
        return [f"{k // good * BATCH + _LEAST + k % good:04d}" for k in range(self.settings.pairs)]

    def run(self, job: str) -> Outcome:
        """Prepare the pair for every method, register it once by each, untimed, and then in rounds."""
        pair = related(int(job), self.settings.seed, "yaw", self.settings.edge)
        if pair is None:
            return Outcome(())
        methods = [self._timed(method, pair) for method in self.settings.compared.methods]
        for _ in range(ROUNDS):
            for method in methods:
                method.measure()
        return Outcome(tuple(method.row(pair) for method in methods), tuple(method.seconds(pair) for method in methods))

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """The times."""
        return speed_section(rows, seconds, self.settings)

    def _timed(self, method: str, pair: SetPair) -> "_TimedMethod":
        """A method with the pair prepared. A scan is prepared before the clock runs, as that brings what is lazy."""
        built = registrar(method, pair.grid, self.device)
        try:
            built.prepare(pair.target)
            finish_device(built)
            start = perf_counter()
            scans = (built.prepare(pair.target), built.prepare(pair.source))
            finish_device(built)
            prepare = (perf_counter() - start) / 2
            return _TimedMethod(method, built, scans, prepare, built.register(*scans))
        except InputError:
            return _TimedMethod(method, built, None, float("nan"), None)


@dataclass(slots=True)
class _TimedMethod:
    """One method on one pair."""

    method: str  # a key of METHODS
    registrar: Registrar  # it, built for the pair's grid
    scans: tuple[Any, Any] | None  # target and source, prepared; None where it does not take them
    prepare: float  # the time of one scan [s]
    found: Registration | None  # what it answers
    register: float = float("inf")  # the least time of the pair so far [s]

    def measure(self) -> None:
        """Register the pair once more."""
        if self.scans is not None:
            start = perf_counter()
            self.registrar.register(*self.scans)
            self.register = min(self.register, perf_counter() - start)

    def row(self, pair: SetPair) -> Row:
        """Which pair, and whether the answer is right."""
        score = {"right": False, "accepted": False}
        if self.found is not None and pair.truth is not None:
            right = errors(self.found, pair.truth, pair.grid.voxel)["right"]
            score = {"right": bool(right), "accepted": bool(self.found.accepted)}
        return pair.cells | {"method": self.method} | score

    def seconds(self, pair: SetPair) -> Row:
        """The times; NaN where there is none."""
        return {
            "number": pair.cells["number"],
            "method": self.method,
            "prepare_s": self.prepare,
            "register_s": self.register if self.scans is not None else float("nan"),
        }


def create(request: Request) -> Speed:
    """The experiment as the command line asks for it; `quick` is two pairs on half the voxels."""
    return Speed(pair_set_settings(request, PAIRS, quick_pairs=2), request.opened.selector)
