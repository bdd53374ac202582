"""Time things that do the same, taking turns, and sum the times up."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
T = TypeVar("T")

# A slow twin is run less often: about this long in all [s], but at least so many times.
_TWIN_SECONDS = 5.0
_FEWEST = 3


@dataclass(frozen=True, slots=True)
class Times:
    """Median, quartiles and ends of repeated measurements of one duration [s]."""

    count: int
    median: float
    first_quartile: float
    third_quartile: float
    least: float
    most: float

    @property
    def most_over_median(self) -> float:
        """How far the slowest stands out: 1 where the time is fixed."""
        return self.most / self.median


def summarize(seconds: Sequence[float]) -> Times:
    """Median, quartiles (interpolated between neighbors) and ends of at least one duration."""
    least, first, median, third, most = np.quantile(seconds, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return Times(len(seconds), median, first, third, least, most)


def timed(call: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> tuple[float, T]:
    """Seconds of wall time of one call, and what it returned."""
    start = perf_counter()
    returned = call(*arguments, **options)
    return perf_counter() - start, returned


def interleave(
    first: Callable[[], object],
    others: Sequence[Callable[[], object]],
    repeats: int,
    restore: Callable[[], object] = lambda: None,
) -> list[Times]:
    """The times of calls that take turns, so that whatever else the machine does meets all alike.

    Each is called once before, untimed: memory is touched for the first time then.

    Args:
        first: called `repeats` times.
        others: called as often, or less where that would take long; their turns are spread over the first's.
        repeats: at least 1.
        restore: what puts the inputs back that the calls overwrite; called before every round, untimed.

    Returns:
        The times of the first and of the others, in their order.
    """
    restore()
    first()
    turns = [min(repeats, max(_FEWEST, int(_TWIN_SECONDS / max(timed(call)[0], 1e-9)))) for call in others]
    seconds: list[list[float]] = [[] for _ in (first, *others)]
    for n in range(repeats):
        restore()
        seconds[0].append(timed(first)[0])
        for call, share, times in zip(others, turns, seconds[1:], strict=True):
            if (n + 1) * share // repeats > n * share // repeats:
                times.append(timed(call)[0])
    return [summarize(times) for times in seconds]
