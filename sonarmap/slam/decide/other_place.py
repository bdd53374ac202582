"""Parts of a map that other pairs place elsewhere with about as much evidence: places of similar shape, taken for one.

Hypotheses that agree with each other, but not with the map, place one part of it elsewhere. If they are right, the
pairs that join this part to the rest are wrong: at least those of the weakest cut between both sides, which a maximum
flow finds (Ford and Fulkerson 1956, DOI 10.4153/CJM-1956-045-5) with the pairs' weights as capacities.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from sonarmap.slam.decide.consistency import MIN_LEAD, chain_parts, compare, independent_weight
from sonarmap.slam.decide.possible_edge import MIN_JOINT_WEIGHT, PossibleEdge, possible_edges
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.pair import Pair

_UNITS = 100  # of a weight, as capacities are integers
_ENDLESS = 2**24  # capacity


@dataclass(frozen=True, slots=True)
class OtherPlace:
    """A part of a map that may lie elsewhere."""

    scans: tuple[int, ...]  # of the part, ascending
    pairs: tuple[tuple[int, int], ...]  # the scans of the pairs that place it elsewhere
    joints: tuple[tuple[int, int], ...]  # the scans of the pairs that place it where it is

    def renumbered(self, number: Sequence[int]) -> "OtherPlace":
        """The part with other numbers for its scans."""
        pairs, joints = (tuple((number[i], number[j]) for i, j in each) for each in (self.pairs, self.joints))
        return OtherPlace(tuple(number[k] for k in self.scans), pairs, joints)


def other_places(graph: PoseGraph, pairs: Sequence[Pair], floor: np.ndarray, bound: float) -> tuple[OtherPlace, ...]:
    """The parts that a group of hypotheses places elsewhere, those with the most evidence first.

    Args:
        graph: of the kept edges.
        pairs: with their verdicts.
        floor: (6,) standard deviations added in quadrature to those of every hypothesis [rad, m].
        bound: largest distance of two hypotheses that agree [sigmas].
    """
    sought = {pair.scans for pair in pairs if pair.is_sought}
    kept = [PossibleEdge(e.i, e.j, e.registration, expected=(e.i, e.j) in sought) for e in graph.edges if e.is_of_pair]
    hypotheses = [edge for pair in pairs for edge in possible_edges(pair) if not edge.fault]
    comparison = compare(chain_parts(len(graph.trajectory), graph.edges), hypotheses, floor, bound)
    found: list[tuple[float, OtherPlace]] = []
    for numbers in comparison.contradicting(hypotheses):
        group = [hypotheses[k] for k in numbers]
        weight = independent_weight(group)
        if weight < MIN_JOINT_WEIGHT or not {each.i for each in group}.isdisjoint(each.j for each in group):
            continue
        inside = _side(graph, kept, group)
        joints = [each for each in kept if inside[each.i] != inside[each.j]]
        if joints and weight > independent_weight(joints) - MIN_LEAD:
            part = np.flatnonzero(inside if 2 * inside.sum() <= len(inside) else ~inside)
            scans = (tuple(each.scans for each in side) for side in (group, joints))
            found.append((weight, OtherPlace(tuple(part.tolist()), *scans)))
    return tuple(place for _, place in sorted(found, key=lambda each: -each[0]))


def _side(graph: PoseGraph, kept: Sequence[PossibleEdge], group: Sequence[PossibleEdge]) -> np.ndarray:
    """(N,) bool, the scans on the targets' side of the weakest cut between targets and sources of a group."""
    count = len(graph.trajectory)
    start, end = count, count + 1
    # of pairs that were sought at an expected pose only the best counts, so that each alone adds nothing
    links = [(*each.scans, 1 + round(_UNITS * (not each.expected) * each.weight)) for each in kept]
    # neither instruments nor a person are doubted
    certain = [(edge.i, edge.j) for edge in graph.edges if edge.by_hand or not edge.is_registered]
    certain += pairwise(graph.gauge.in_world)
    certain += [(start, k) for k in {each.i for each in group}] + [(k, end) for k in {each.j for each in group}]
    i, j, capacity = np.array([*links, *((*ends, _ENDLESS) for ends in certain)], np.int32).T
    ends = np.concatenate([i, j]), np.concatenate([j, i])
    network = csr_array((np.concatenate([capacity, capacity]), ends), shape=(count + 2, count + 2))
    remaining = network - maximum_flow(network, start, end).flow
    remaining.eliminate_zeros()
    inside = np.zeros(count + 2, bool)
    inside[breadth_first_order(remaining, start, return_predecessors=False)] = True
    return inside[:count]
