"""A map's scans in portions of neighbors, which this process or workers take one after the other, with the same result:
what a portion needs travels with it, and no more of it is in memory than is worked at."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from sonarmap.slam.execute.executor import Executor
from sonarmap.spectral.scan import Scan

_Result = TypeVar("_Result")

_MOST_POINTS = 200_000  # of a portion's scans together
_MOST_SCANS = 64  # of a portion


def in_portions(
    executor: Executor, scans: Sequence[Scan], task: Callable[..., _Result], needs: Callable[[range], tuple[Any, ...]]
) -> Iterator[tuple[range, _Result]]:
    """The result of a task for every portion, and the places of its scans, in the order in which they are done.

    Args:
        executor: runs the task, which is pickled where workers are processes.
        task: takes what `needs` gives for the places of a portion, called when it is begun.
    """
    portions = _portions([len(scan.points) for scan in scans])
    # a portion is a job, and a piece of work
    pieces = executor.run(_of_piece, portions, 1, lambda piece: (task, needs(piece[0])))
    for places, (result,) in pieces:
        yield portions[places.start], result


def _portions(sizes: Sequence[int]) -> list[range]:
    """The places of scans of so many points, cut into portions."""
    portions: list[range] = []
    start, points = 0, 0
    for place, size in enumerate(sizes):
        if place > start and (points + size > _MOST_POINTS or place - start == _MOST_SCANS):
            portions.append(range(start, place))
            start, points = place, 0
        points += size
    return [*portions, range(start, len(sizes))]


def _of_piece(_: Sequence[range], task: Callable[..., _Result], needs: tuple[Any, ...]) -> list[_Result]:
    # how BLAS sums depends on the number of its threads
    with threadpool_limits(1, "blas"):
        return [task(*needs)]
