# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""How far apart two scans are along the edges of a graph: what a loop between them would tie together."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slam.graph.edge import Edge

# Poses from which ways are searched at a time; bounds the memory.
_TOGETHER = 500


def separations(count: int, edges: Sequence[Edge], pairs: np.ndarray) -> np.ndarray:
    """(m,) how many edges the shortest way between two poses has; infinite where there is none.

    Args:
        count: of the poses.
        edges: measurements between them.
        pairs: (m, 2) int, poses.
    """
    ends = np.array([(edge.i, edge.j) for edge in edges if edge.kind != "prior"], np.intp).reshape(-1, 2)
    graph = sparse.csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    result = np.empty(len(pairs))
    sources, row = np.unique(pairs[:, 0], return_inverse=True)
    for start in range(0, len(sources), _TOGETHER):
        ways = dijkstra(graph, directed=False, unweighted=True, indices=sources[start : start + _TOGETHER])
        mine = np.flatnonzero((row >= start) & (row < start + _TOGETHER))
        result[mine] = ways[row[mine] - start, pairs[mine, 1]]
    return result
