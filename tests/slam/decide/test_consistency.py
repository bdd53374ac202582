"""Which answers agree: cycles through the chain, groups, parts that are joined; by laws."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide import consistency
from sonarmap.slam.decide.consistency import Chains, chain_parts, compare
from sonarmap.slam.decide.possible_edge import PossibleEdge, Support, possible_edges
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.result import Registration
from tests.samples.surveys import (
    chain_edges,
    chained_graph,
    edge,
    random_covariance,
    registration,
    ring_poses,
)

COVARIANCE = random_covariance(np.random.default_rng(2), 0.004, 0.03)


def test_covariances_of_chains_equal_marginals_of_the_graph():
    """Of a chain, and of a random tree, in which the way between two scans passes where their ways divide."""
    truth, rng = ring_poses(20), np.random.default_rng(8)
    before = [(int(rng.integers(k)), k) for k in range(1, 20)]
    tree = [edge(i, j, truth[i].inv() * truth[j], COVARIANCE, "loop") for i, j in before]
    ways = [*permutations(range(20), 2)]
    for edges, pairs in ((chain_edges(truth, COVARIANCE), ((0, 8), (2, 5), (6, 3))), (tree, ways)):
        chains, solution = chain_parts(len(edges) + 1, edges), chained_graph(edges, len(edges) + 1).optimize()
        for i, j in pairs:
            gathered = propagated(chains.T[j].inv(), chains.between(np.array([i]), np.array([j]))[0])
            np.testing.assert_allclose(gathered, solution.relative(i, j)[1], rtol=1e-3, atol=1e-9)
        assert chains.meeting(np.array([7]), np.array([7])).tolist() == [7]


BOUND = 4.74


NO_FLOOR = np.zeros(6)


def _inverse(given: Registration) -> Registration:
    T = given.T_target_source
    return replace(given, T_target_source=T.inv(), covariance=propagated(T, given.covariance))


def answer(truth: RigidTransform, i: int, j: int, off: RigidTransform | None = None, **changes) -> PossibleEdge:
    T = truth[i].inv() * truth[j] * (RigidTransform.identity() if off is None else off)
    return PossibleEdge(i, j, replace(registration(T, COVARIANCE), **changes))


def chained(truth: RigidTransform, gaps: tuple[int, ...] = ()) -> Chains:
    """The true poses chained without noise, with none of (k, k + 1) for the gaps."""
    return chain_parts(len(truth), [one for one in chain_edges(truth, COVARIANCE) if one.i not in gaps])


def support_of(chains: Chains, answers: list[PossibleEdge], floor: np.ndarray, bound: float) -> list[Support]:
    return [possible.support for possible in compare(chains, answers, floor, bound).support(answers)]


def answers_of(i: int, j: int, given: Registration) -> list[PossibleEdge]:
    return possible_edges(RegisteredPair(i, j, "loop", registration=given))


def test_support_does_not_depend_on_direction_and_hypotheses_of_one_pair_exclude_each_other():
    truth = ring_poses(12)
    answers = [answer(truth, 1, 7), answer(truth, 3, 9)]
    turned = [answers[0], PossibleEdge(9, 3, _inverse(answers[1].registration))]
    for among in (answers, turned):
        assert [one.pairs for one in support_of(chained(truth, (5,)), among, NO_FLOOR, BOUND)] == [2, 2]
    twin = answer(truth, 1, 7, RigidTransform.from_exp_coords([0, 0, 0.001, 0, 0, 0]))
    found = support_of(chained(truth, (5,)), [answer(truth, 1, 7), twin], NO_FLOOR, BOUND)
    assert [one.pairs for one in found] == [1, 1]
    assert not any(one.leading for one in found)  # neither is clearly ahead


def test_comparing_only_the_nearest_hypotheses_gives_the_same_verdicts(monkeypatch: pytest.MonkeyPatch):
    """What is far off at either end decides nothing: right and wrong answers come out as if all were compared."""
    truth = ring_poses(60, radius=30.0, turns=2.0)
    off = RigidTransform.from_translation([4.0, 0, 0])
    right = [answer(truth, k, k + 30) for k in range(30)]
    wrong = [answer(truth, k, k + 28, truth[k + 28].inv() * off * truth[k + 28]) for k in (3, 4, 5, 20)]
    chains = chained(truth)
    every = support_of(chains, [*right, *wrong], NO_FLOOR, BOUND)
    monkeypatch.setattr(consistency, "_COMPARED", 6)
    near = support_of(chains, [*right, *wrong], NO_FLOOR, BOUND)
    assert [(one.agrees, one.leading) for one in near] == [(one.agrees, one.leading) for one in every]
    assert [one.pairs for one in near[30:]] == [3, 3, 3, 1]  # three neighbors say the same
    assert {one.pairs for one in near[:30]} == {30}


def test_distance_from_the_chain_is_in_joint_sigmas():
    truth = ring_poses(6)
    chains = chained(truth)
    gathered = propagated(truth[4].inv(), chains.between(np.array([1]), np.array([4]))[0])
    root = np.linalg.cholesky(gathered + COVARIANCE)
    for sigmas in (3.0, 6.0):
        off = RigidTransform.from_exp_coords(sigmas * root[:, 2])
        (found,) = support_of(chains, [answer(truth, 1, 4, off)], NO_FLOOR, BOUND)
        assert found.sigmas == pytest.approx(sigmas, rel=0.01)
        assert found.agrees == (sigmas < BOUND)
    (granted,) = support_of(chains, [answer(truth, 1, 4, off)], np.repeat([0.1, 1.0], 3), BOUND)
    assert granted.agrees


def test_agreeing_hypotheses_join_components_in_any_frames():
    truth = ring_poses(12)
    off = [RigidTransform.from_exp_coords(xi) for xi in ([0, 0, 0.8, 2, 0, 0], [0.2, 0, -1, 0, 3, 0])]
    answers = [answer(truth, 1, 7), answer(truth, 3, 9), answer(truth, 2, 10), answer(truth, 4, 8, off[0])]
    answers.append(answer(truth, 5, 11, off[1]))
    found = support_of(chained(truth, (5,)), answers, NO_FLOOR, BOUND)
    assert [one.pairs for one in found] == [3, 3, 3, 1, 1]
    assert [one.leading for one in found] == [True, True, True, False, False]
    assert all(np.isnan(one.sigmas) and not one.agrees for one in found)
    # the second part's frame is its first scan's, whatever that is
    moved = chained(truth, (5,))
    T = RigidTransform.from_exp_coords([0.4, -0.3, 1.2, 9, 8, -7])
    poses = RigidTransform.concatenate([moved.T[:6], T * moved.T[6:]])
    again = replace(moved, T=poses, covariance=moved.covariance.copy())
    again.covariance[6:] = propagated(T, again.covariance[6:])
    repeated = support_of(again, answers, NO_FLOOR, BOUND)
    assert [(one.pairs, one.leading) for one in repeated] == [(one.pairs, one.leading) for one in found]


def test_possible_edges_weigh_by_their_probability():
    first = replace(registration(RigidTransform.identity(), COVARIANCE), probability=0.7, accepted=False)
    second, faint = replace(first, probability=0.2), replace(first, probability=0.001)
    found = answers_of(2, 5, replace(first, alternatives=(second, faint)))
    assert [(one.rank, one.accepted) for one in found] == [(0, False), (1, False)]
    assert found[0].weight == pytest.approx(-np.log(0.3))
    assert found[1].weight == pytest.approx(-np.log(0.8))
    assert answers_of(2, 5, faint) == []
    unknown = registration(RigidTransform.identity(), COVARIANCE)
    assert answers_of(2, 5, unknown)[0].weight > 1
    assert answers_of(2, 5, replace(unknown, accepted=False)) == []
    bad = replace(registration(RigidTransform.identity(), COVARIANCE), covariance=np.zeros((6, 6)))
    assert "positive definite" in PossibleEdge(0, 4, bad).fault
    assert PossibleEdge(0, 4, replace(bad, covariance=COVARIANCE)).fault == ""


@pytest.mark.parametrize(("open_by", "off", "elsewhere"), [(50.0, 25.0, True), (50.0, 15.0, False), (1.0, 25.0, False)])
def test_hypothesis_with_unconstrained_direction_is_used_only_near_the_chain(open_by, off, elsewhere):
    """With a floor of 1 m: 20 m are far. The direction lies across all axes."""
    truth, along = ring_poses(6), np.array([0.6, 0.0, -0.8])
    covariance = COVARIANCE.copy()
    covariance[3:, 3:] += open_by**2 * np.outer(along, along)
    away = RigidTransform.from_translation(off * along)
    given = answer(truth, 1, 4, away, covariance=covariance, accepted=True)
    floor = np.repeat([0.02, 1.0], 3)
    (found,) = compare(chained(truth), [given], floor, BOUND).support([given])
    assert (found.support.elsewhere, found.support.agrees) == (elsewhere, open_by > off)
    assert found.may_be_taken == (open_by > off and not elsewhere)
