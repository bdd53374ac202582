"""What a person says of pairs: rejected, accepted and added ties, and what they cost."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.loops.settings import LoopSettings
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.pair import Pair
from sonarmap.slam.stream.keys import KeySettings
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registration
from tests.samples.surveys import (
    KnowingRegistrar,
    position_error,
    random_covariance,
    registration,
    ring_poses,
    scans_of,
)

VOXEL = 0.5
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)
WRONG = RigidTransform.from_exp_coords([0, 0, 0.6, 4, -1, 0])
TRUTH = ring_poses(24)
SCANS = scans_of(TRUTH)
NO_LOOPS = MapperSettings(loops=LoopSettings(per_scan=0))


def mapped(ties: list[Tie], registrar: KnowingRegistrar, settings: MapperSettings | None = None) -> SurveyResult:
    return Mapper(registrar, VOXEL, settings).run(SCANS, ties=ties)


def error(result: SurveyResult) -> float:
    return position_error(result.trajectory.T_world_sensor, TRUTH)


def pair_of(result: SurveyResult, i: int, j: int) -> Pair:
    return next(pair for pair in result.pairs if pair.scans == (i, j))


def measured(i: int, j: int, off: RigidTransform | None = None) -> Registration:
    """As a person might measure it: 1 degree, 5 cm."""
    T = TRUTH[i].inv() * TRUTH[j] * (RigidTransform.identity() if off is None else off)
    return replace(registration(T, np.diag(np.repeat([0.0175, 0.05], 3) ** 2)), reason="measured by hand")


def test_a_false_tie_is_told_with_its_size_and_rejecting_it_undoes_it():
    registrar = KnowingRegistrar(TRUTH, 4 * COVARIANCE)
    alone = mapped([], registrar)
    false = mapped([Tie(3, 17, "add", measured(3, 17, WRONG), "planted")], registrar)
    tied = pair_of(false, 3, 17)
    assert tied.kept
    assert (tied.by_hand, tied.note) == ("given", "planted")
    assert tied.contradicted > 300
    assert error(false) > 5 * error(alone)
    assert len(false.displaced) >= 1
    rejected = mapped([Tie(3, 17, "reject")], registrar)
    np.testing.assert_array_equal(
        rejected.trajectory.T_world_sensor.as_matrix(), alone.trajectory.T_world_sensor.as_matrix()
    )


def test_a_false_loop_is_accepted_rejected_and_nothing_is_registered_for_it():
    """All pairs are searched for as without ties, so that a journal has them all; the added one alone is new."""

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, T_target_source=given.T_target_source * WRONG) if j - i > 20 else given

    asked = []
    for ties in ([], [Tie(0, 23, "accept")], [Tie(0, 23, "reject")], [Tie(5, 6, "reject"), Tie(2, 21, "add")]):
        registrar = KnowingRegistrar(TRUTH, COVARIANCE, spoil)
        result = mapped(ties, registrar)
        asked.append((set(registrar.pairs), error(result), result))
    (pairs, alone, first), (accepting, bent, second), (rejecting, straight, third), (adding, _, fourth) = asked
    assert (0, 23) in pairs
    assert not pair_of(first, 0, 23).kept
    assert accepting == rejecting == pairs
    assert adding - pairs <= {(2, 21)}
    assert pair_of(second, 0, 23).kept
    assert pair_of(second, 0, 23).contradicted > 100
    assert "accepted by hand" in pair_of(second, 0, 23).reason
    assert bent > 3 * alone
    assert straight == pytest.approx(alone, abs=0.02)
    assert pair_of(third, 0, 23).reason == "rejected by hand"
    assert (5, 6) in fourth.gaps
    assert len(fourth.components) == 1


def test_a_true_loop_added_to_a_chain_closes_it():
    registrar = KnowingRegistrar(TRUTH, 9 * COVARIANCE)
    chained = mapped([], registrar, NO_LOOPS)
    before = len(registrar.pairs)
    closed = mapped([Tie(0, 22, "add"), Tie(4, 15, "add", measured(4, 15))], registrar, NO_LOOPS)
    assert registrar.pairs[before:].count((0, 22)) == 1
    assert len(registrar.pairs) == 2 * before + 1
    assert error(closed) < 0.7 * error(chained)
    assert max(pair_of(closed, *scans).contradicted for scans in ((0, 22), (4, 15))) < 22.5
    assert closed.solution.graph.edges[-1].kind in ("loop", "tie")


def test_ties_join_parts_that_nothing_joins():
    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, accepted=False, probability=0.0, reason="too weak") if i <= 11 < j else given

    def joined(*ties: Tie) -> SurveyResult:
        return mapped(list(ties), KnowingRegistrar(TRUTH, COVARIANCE, spoil))

    assert len(joined().components) == 2
    added = Tie(9, 17, "add"), Tie(9, 17, "add", measured(9, 17))
    for tie in (Tie(11, 12, "accept"), Tie(10, 13, "accept"), *added):
        result = joined(tie)
        assert len(result.components) == 1
        assert error(result) < 0.6
        assert pair_of(result, *tie.scans).contradicted == pytest.approx(0, abs=1e-6)
    assert len(joined(Tie(11, 12, "reject")).components) == 2


def test_accepting_a_pair_keeps_the_answer_that_the_survey_takes():
    """The more probable answer of (2, 21) is wrong, and the survey takes the other: to accept it changes nothing."""

    def spoil(i: int, j: int, given: Registration) -> Registration:
        if (i, j) != (2, 21):
            return given
        right = replace(given, accepted=False, probability=0.4, reason="not sure")
        wrong = replace(right, T_target_source=given.T_target_source * WRONG, probability=0.55)
        return replace(wrong, alternatives=(right,))

    registrar = KnowingRegistrar(TRUTH, COVARIANCE, spoil)
    tried = mapped([Tie(2, 21, "add")], registrar)
    edge = pair_of(tried, 2, 21).edge
    assert edge is not None
    off = edge.registration.T_target_source.translation - (TRUTH[2].inv() * TRUTH[21]).translation
    assert float(np.linalg.norm(off)) < 0.3
    assert error(tried) < 0.3


def test_what_cannot_be_is_left_out_in_words():
    def spoil(i: int, j: int, given: Registration) -> Registration:
        if (i, j) == (1, 20):
            raise InputError("all in one plane")
        return given

    registrar = KnowingRegistrar(TRUTH, COVARIANCE, spoil)
    result = mapped([Tie(1, 20, "add"), Tie(3, 14, "accept"), Tie(4, 16, "reject")], registrar, NO_LOOPS)
    assert pair_of(result, 1, 20).reason == "failed: an error of the method, not of the scans: all in one plane"
    assert not pair_of(result, 1, 20).kept
    assert all(pair.scans not in ((3, 14), (4, 16)) for pair in result.pairs)
    assert len(result.components) == 1


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((4, 4, "accept"), "two different"),
        ((7, 4, "accept"), "the lower first"),
        ((1, 2, "maybe"), "accept, reject, add"),
        ((1, 2, "reject", measured(1, 2)), "only add"),
        ((1, 2, np.array(["add", "reject"])), "accept, reject, add"),
        ((0.5, 2, "accept"), "two different"),
        ((1, None, "accept"), "two different"),
        ((1, 2, "add", 5), "is 5; wanted a Registration"),
    ],
)
def test_ties_refuse_what_makes_no_sense(given: tuple, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Tie(*given)


def test_a_tie_of_a_scan_that_no_registration_places_is_refused():
    dense = ring_poses(60, turns=0.5)
    mapper = Mapper(KnowingRegistrar(dense, COVARIANCE), VOXEL, MapperSettings(keys=KeySettings(3.0)))
    plain = mapper.run(scans_of(dense))
    assert plain.keys is not None
    between = next(k for k in range(60) if k not in plain.keys)
    with pytest.raises(InputError, match=f"scan{between} is not a key scan"):
        mapper.run(scans_of(dense), ties=[Tie(0, between, "reject")])
    first, last = plain.keys[0], plain.keys[-1]
    tied = mapper.run(scans_of(dense), ties=[Tie(first, last, "add")])
    assert pair_of(tied, first, last).by_hand == "add"
    assert pair_of(tied, first, last).kept
