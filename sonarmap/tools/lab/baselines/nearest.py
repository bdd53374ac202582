"""Nearest neighbors on all cores that this process may use, in a way that an interrupt cannot crash."""

from concurrent.futures import Future
from threading import Thread
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.device.threads import thread_count


def query_on_all_cores(
    tree: KDTree, points: np.ndarray, k: Any = 1, reach: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Distances and indices of the nearest points of a tree, as `KDTree.query` gives them.

    SciPy's own threads read the caller's arrays. Were the main thread interrupted while it waits for them, the arrays
    would be freed under them and the process would crash (SciPy 1.17). An interrupt reaches the main thread alone, so
    another thread makes the call: it keeps the arrays until SciPy is done. It is a new one each time, as a pool whose
    first thread is interrupted while it starts would never end.

    Args:
        tree: M points (M, D).
        points: (N, D), in the tree's unit.
        k: how many neighbors, or a list of which, counted from 1.
        reach: neighbors farther away are left out: infinite distance and index M [the tree's unit].
    """
    answer: Future[tuple[Any, Any]] = Future()

    def query() -> None:
        try:
            answer.set_result(tree.query(points, k, distance_upper_bound=reach, workers=thread_count()))
        except BaseException as error:  # noqa: BLE001 - the caller raises it
            answer.set_exception(error)

    Thread(target=query, name="nearest neighbors").start()
    distance, index = answer.result()
    return np.asarray(distance), np.asarray(index)
