"""Paths through a pose graph: which edges no path can avoid."""

from collections.abc import Sequence
from itertools import pairwise

from sonarmap.slam.graph.edge import Edge


def bridges(count: int, edges: Sequence[Edge], in_world: Sequence[int] = ()) -> set[int]:
    """The edges, by index, without which a component of `count` poses would fall apart (Tarjan, IPL 1974).

    Poses `in_world` hold together without edges.
    """
    neighbors: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for number, (one, other) in enumerate(pairwise(in_world), len(edges)):
        # twice, so that neither is necessary
        for index in (number, number + count):
            neighbors[one].append((other, index))
            neighbors[other].append((one, index))
    for index, edge in enumerate(edges):
        if edge.kind != "prior":
            neighbors[edge.i].append((edge.j, index))
            neighbors[edge.j].append((edge.i, index))
    order, low, necessary = [-1] * count, [0] * count, set[int]()
    reached = 0
    for root in range(count):
        if order[root] >= 0:
            continue
        order[root] = low[root] = reached = reached + 1
        path = [(root, -1, iter(neighbors[root]))]
        while path:
            pose, by, rest = path[-1]
            step = next(((other, index) for other, index in rest if index != by), None)
            if step is None:
                path.pop()
                if path:
                    before = path[-1][0]
                    low[before] = min(low[before], low[pose])
                    if low[pose] == order[pose]:
                        necessary.add(by)
            elif order[step[0]] >= 0:
                low[pose] = min(low[pose], order[step[0]])
            else:
                order[step[0]] = low[step[0]] = reached = reached + 1
                path.append((*step, iter(neighbors[step[0]])))
    return necessary
