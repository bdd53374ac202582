"""How long a pair takes, by every method: the same pairs, in turn, in one process."""

import math
from collections.abc import Sequence
from time import perf_counter
from typing import Any, ClassVar

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registrar
from sonarmap.tools.lab.reproduce.answer import errors, finish_device
from sonarmap.tools.lab.reproduce.evaluation.pair_set import SOURCES, SetPair, related
from sonarmap.tools.lab.reproduce.evaluation.settings import BATCH, pair_set_settings
from sonarmap.tools.lab.reproduce.evaluation.speed_section import speed_section
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import registrar
from sonarmap.tools.methods.registry import ALL_METHODS

ROUNDS = 3  # of each pair, of which the fastest counts
_LEAST = 1  # so many of each five pairs share too little: 5 to 20 %


PAIRS = 60


class Speed(Experiment):
    """Times every method on pairs with the turn "yaw" that share more than a fifth; a job is one pair."""

    name = "speed"
    sources: ClassVar[tuple[str, ...]] = (*SOURCES, *ALL_METHODS)
    make_section = staticmethod(speed_section)

    def jobs(self) -> Sequence[str]:
        """The pairs' numbers in the set."""
        good = BATCH - _LEAST
        return [f"{k // good * BATCH + _LEAST + k % good:04d}" for k in range(self.settings.pairs)]

    def run(self, job: str) -> Outcome:
        """Prepare the pair for every method, register it once by each, untimed, and then in rounds.

        A method that does not take the scans has no times.
        """
        pair = related(int(job), self.settings.seed, "yaw", self.settings.edge)
        if pair is None or pair.truth is None:
            return Outcome(())
        rows, seconds, ready = [], [], []
        for method in self.settings.compared.methods:
            score = {"right": False, "accepted": False}
            times = {"number": pair.cells["number"], "method": method, "prepare_s": math.nan, "register_s": math.nan}
            built = registrar(method, pair.grid, self.device)
            try:
                scans, prepare = _prepared(built, pair)
                found = built.register(*scans)
            except InputError:
                pass
            else:
                is_right = bool(errors(found, pair.truth, pair.grid.voxel)["right"])
                score = {"right": is_right, "accepted": bool(found.accepted)}
                times |= {"prepare_s": prepare, "register_s": math.inf}
                ready.append((built, scans, times))
            rows.append(pair.cells | {"method": method} | score)
            seconds.append(times)
        for _ in range(ROUNDS):
            for built, scans, times in ready:
                start = perf_counter()
                built.register(*scans)
                times["register_s"] = min(times["register_s"], perf_counter() - start)
        return Outcome(tuple(rows), tuple(seconds))


def _prepared(built: Registrar, pair: SetPair) -> tuple[tuple[Any, Any], float]:
    """Target and source, and the time of one [s]; before the clock runs a scan brings what is lazy."""
    built.prepare(pair.target)
    finish_device(built)
    start = perf_counter()
    scans = (built.prepare(pair.target), built.prepare(pair.source))
    finish_device(built)
    return scans, (perf_counter() - start) / 2


def create(request: Request) -> Speed:
    """The experiment as the command line asks for it; `quick` is two pairs on half the voxels."""
    return Speed(pair_set_settings(request, PAIRS, quick_pairs=2), request.opened.selector)
