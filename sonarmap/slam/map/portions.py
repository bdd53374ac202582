"""Work on a map's scans in portions of neighbors, by this process or by workers, with the same result. Each portion
carries what it needs, and only the portions in work are in memory."""

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
    """The positions of every portion's scans and the result of a task for it, in the order in which they are done.

    Args:
        executor: runs the task, which is pickled where workers are processes.
        task: takes the arguments that `needs` returns for a portion's positions when the portion is begun.
    """
    portions = _portions([len(scan.points) for scan in scans])
    arguments = ((task, needs(places)) for places in portions)
    for number, result in executor.run(_in_one_thread, arguments):
        yield portions[number], result


def _portions(sizes: Sequence[int]) -> list[range]:
    """The positions of scans with these numbers of points, cut into portions."""
    portions: list[range] = []
    start, points = 0, 0
    for place, size in enumerate(sizes):
        if place > start and (points + size > _MOST_POINTS or place - start == _MOST_SCANS):
            portions.append(range(start, place))
            start, points = place, 0
        points += size
    return [*portions, range(start, len(sizes))]


def _in_one_thread(task: Callable[..., _Result], needs: tuple[Any, ...]) -> _Result:
    # the rounding of BLAS depends on the number of its threads
    with threadpool_limits(1, "blas"):
        return task(*needs)
