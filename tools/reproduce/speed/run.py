"""How long a pair takes, by every method: the same pairs, in turn, in one process."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar

from kernels.errors import InputError
from spectral.grid import Grid
from spectral.result import Registrar, Registration
from tools.reproduce.evaluation.answer import errors
from tools.reproduce.evaluation.lineup import Lineup, lineup, registrar
from tools.reproduce.evaluation.set_pairs import BATCH, SET_SEED, SetPair, related
from tools.reproduce.experiment import Outcome, Row, Section
from tools.reproduce.experiments import Request
from tools.reproduce.speed.section import speed_section

ROUNDS = 3  # of each pair, of which the fastest counts
_LEAST = 1  # so many of each five pairs share too little: 5 to 20 %


@dataclass(frozen=True, slots=True)
class SpeedSettings:
    """What is run.

    Attributes:
        pairs: how many.
        seed: of the set.
        edge: voxels per edge; their size is chosen for each pair.
        lineup: the methods.
    """

    pairs: int = 60
    seed: int = SET_SEED
    edge: int = 128
    lineup: Lineup = field(default_factory=Lineup)

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        if self.pairs < 1 or self.seed < 0:
            raise InputError(f"{self.pairs} pairs of the set {self.seed}; wanted 1 or more, of one >= 0")


class Speed:
    """Times every method on pairs with the turn "yaw" that share more than a fifth; a job is one pair."""

    name: ClassVar[str] = "speed"

    def __init__(self, settings: SpeedSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self._device = device

    def jobs(self) -> Sequence[str]:
        """The pairs' numbers in the set."""
        good = BATCH - _LEAST
        return [f"{k // good * BATCH + _LEAST + k % good:04d}" for k in range(self.settings.pairs)]

    def run(self, job: str) -> Outcome:
        """Prepare the pair for every method, register it once by each, untimed, and then in rounds."""
        pair = related(int(job), self.settings.seed, "yaw", self.settings.edge)
        if pair is None:
            return Outcome(())
        benches = [self._bench(method, pair) for method in self.settings.lineup.methods]
        for _ in range(ROUNDS):
            for bench in benches:
                bench.measure()
        return Outcome(tuple(one.row(pair) for one in benches), tuple(one.seconds(pair) for one in benches))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The times."""
        seconds = [row for one in outcomes.values() for row in one.seconds]
        return speed_section([row for one in outcomes.values() for row in one.rows], seconds, self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Nothing: a picture of times would differ from run to run."""

    def _bench(self, method: str, pair: SetPair) -> "_Bench":
        """A method with the pair prepared. A scan is prepared before the clock runs, as that brings what is lazy."""
        built = registrar(method, pair.grid, self._device)
        try:
            built.prepare(pair.target)
            _finish(built)
            start = perf_counter()
            scans = (built.prepare(pair.target), built.prepare(pair.source))
            _finish(built)
            prepare = (perf_counter() - start) / 2
            return _Bench(method, built, scans, prepare, built.register(*scans))
        except InputError:
            return _Bench(method, built, None, float("nan"), None)


@dataclass(slots=True)
class _Bench:
    """One method on one pair.

    Attributes:
        method: a key of METHODS.
        registrar: it, built for the pair's grid.
        scans: target and source, prepared; None where it does not take them.
        prepare: the time of one scan [s].
        found: what it answers.
        register: the least time of the pair so far [s].
    """

    method: str
    registrar: Registrar
    scans: tuple[Any, Any] | None
    prepare: float
    found: Registration | None
    register: float = float("inf")

    def measure(self) -> None:
        """Register the pair once more."""
        if self.scans is not None:
            start = perf_counter()
            self.registrar.register(*self.scans)
            self.register = min(self.register, perf_counter() - start)

    def row(self, pair: SetPair) -> Row:
        """Which pair, and whether the answer is right."""
        judged = {"right": False, "accepted": False}
        if self.found is not None and pair.truth is not None:
            right = errors(self.found, pair.truth, pair.grid.voxel)["right"]
            judged = {"right": bool(right), "accepted": bool(self.found.accepted)}
        return pair.cells | {"method": self.method} | judged

    def seconds(self, pair: SetPair) -> Row:
        """The times; NaN where there is none."""
        return {
            "number": pair.cells["number"],
            "method": self.method,
            "prepare_s": self.prepare,
            "register_s": self.register if self.scans is not None else float("nan"),
        }


def _finish(built: Registrar) -> None:
    """Wait for the device of a method that has one, so that what follows is timed alone."""
    device = getattr(built, "device", None)
    if device is not None:
        device.queue.finish()


def create(request: Request) -> Speed:
    """The experiment as the command line asks for it; `quick` is two pairs on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    usual, quick = SpeedSettings(), request.quick
    settings = SpeedSettings(
        pairs=request.pairs or (2 if quick else usual.pairs),
        seed=usual.seed if request.seed is None else request.seed,
        edge=request.grid or (64 if quick else usual.edge),
        lineup=lineup(request),
    )
    return Speed(settings, request.opened.selector)
