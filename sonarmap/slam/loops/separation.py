"""How far apart two scans are along the edges of a graph: what a loop between them would tie together."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from sonarmap.slam.graph.edge import Edge


def separations(count: int, edges: Sequence[Edge], pairs: np.ndarray) -> np.ndarray:
    """(m,) how many edges lie between two poses: along the order of the poses, or by way of one loop if that is nearer.

    Ways by several loops may be nearer still, and are not sought: what all of them are takes a time that grows with the
    square of the poses. Infinite where neither is a way.

    Args:
        count: of the poses.
        edges: measurements between them.
        pairs: (m, 2) int, different poses.
    """
    ends = np.array([(edge.i, edge.j) for edge in edges if edge.kind != "prior"], np.intp).reshape(-1, 2)
    low, high = ends.min(axis=1, initial=count), ends.max(axis=1, initial=0)
    follows = np.zeros(count, bool)
    follows[high[high - low == 1]] = True
    # poses without an edge to the one before begin a row of their own, out of reach
    reach = 2 * count
    place = np.arange(count) + reach * np.cumsum(~follows)
    asked = place[np.sort(pairs, axis=1)]
    apart = (asked[:, 1] - asked[:, 0]).astype(np.float64)
    loops = np.flatnonzero(high - low > 1)
    if len(loops):
        tied = np.column_stack([place[low[loops]], place[high[loops]]])
        apart = np.minimum(apart, 1 + KDTree(tied).query(asked, p=1)[0])
    return np.where(apart < count, apart, np.inf)
