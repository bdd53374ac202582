"""Ties and control points of a person: their contradictions, and maps held by control points."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.control import ControlPoint, Use
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.pair import Pair
from sonarmap.slam.stream.keys import KeySettings
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
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


def error(result: SurveyResult, truth: RigidTransform = TRUTH) -> float:
    return position_error(result.trajectory.T_world_sensor, truth)


def pair_of(result: SurveyResult, i: int, j: int) -> Pair:
    return next(pair for pair in result.pairs if pair.scans == (i, j))


def measured(i: int, j: int, off: RigidTransform | None = None) -> Registration:
    """A pair as a person might measure it, to 1 degree and 5 cm."""
    T = TRUTH[i].inv() * TRUTH[j] * (RigidTransform.identity() if off is None else off)
    return replace(registration(T, np.diag(np.repeat([0.0175, 0.05], 3) ** 2)), reason="measured by hand")


def with_false_loops(i: int, j: int, given: Registration) -> Registration:
    return replace(given, T_target_source=given.T_target_source * WRONG) if j - i > 20 else given


@pytest.mark.slow
def test_ties_accept_or_reject_a_false_loop_without_registrations():
    """The same pairs are registered as without ties, so that a journal has them all."""
    runs = []
    for ties in ([], [Tie(0, 23, "accept")], [Tie(0, 23, "reject")]):
        registrar = KnowingRegistrar(TRUTH, COVARIANCE, with_false_loops)
        result = mapped(ties, registrar)
        runs.append((set(registrar.pairs), error(result), result))
    (pairs, alone, first), (accepting, bent, second), (rejecting, straight, third) = runs
    assert (0, 23) in pairs
    assert not pair_of(first, 0, 23).kept
    assert pair_of(first, 0, 23).reason.startswith("refused, inconsistent")
    assert min(pair_of(first, 0, 23).sigmas_from_estimate, pair_of(first, 0, 23).residual) > 4.74
    assert alone < 0.5
    assert accepting == rejecting == pairs
    assert pair_of(second, 0, 23).kept
    assert pair_of(second, 0, 23).contradicted > 100
    assert "accepted by hand" in pair_of(second, 0, 23).reason
    assert bent > 3 * alone
    assert straight == pytest.approx(alone, abs=0.02)
    assert pair_of(third, 0, 23).reason == "rejected by hand"


def test_a_true_loop_added_to_a_chain_closes_it():
    registrar = KnowingRegistrar(TRUTH, 9 * COVARIANCE)
    chained = mapped([], registrar, NO_LOOPS)
    before = len(registrar.pairs)
    of_no_pair = Tie(3, 14, "accept"), Tie(4, 16, "reject")
    closed = mapped([Tie(0, 22, "add"), Tie(4, 15, "add", measured(4, 15)), *of_no_pair], registrar, NO_LOOPS)
    assert all(pair.scans not in ((3, 14), (4, 16)) for pair in closed.pairs)
    assert registrar.pairs[before:].count((0, 22)) == 1
    assert len(registrar.pairs) == 2 * before + 1
    assert error(closed) < 0.7 * error(chained)
    assert max(pair_of(closed, *scans).contradicted for scans in ((0, 22), (4, 15))) < 22.5
    assert closed.solution.graph.edges[-1].kind in ("loop", "tie")


def joined(*ties: Tie) -> SurveyResult:
    """Two parts that only ties join."""
    return mapped(list(ties), KnowingRegistrar(TRUTH, COVARIANCE, halved))


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    "tie",
    [Tie(9, 17, "add", measured(9, 17)), Tie(11, 12, "accept")],
    ids=["measured", "accepted"],
)
def test_ties_join_parts_without_registrations(tie: Tie) -> None:
    result = joined(tie)
    assert len(result.components) == 1
    assert error(result) < 0.6
    assert pair_of(result, *tie.scans).contradicted == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((4, 4, "accept"), "two different"),
        ((7, 4, "accept"), "the lower first"),
        ((1, 2, "reject", measured(1, 2)), "only add"),
        ((1, 2, np.array(["add", "reject"])), "accept, reject, add"),
        ((1, 2, "add", 5), "is 5; wanted a Registration"),
    ],
)
def test_invalid_ties_are_refused(given: tuple, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Tie(*given)


@pytest.mark.slow
def test_a_tie_of_a_scan_that_is_no_key_scan_is_refused():
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


T_WORLD = RigidTransform.from_components([310.0, -45.0, -12.0], Rotation.from_euler("ZYX", [2.1, 0.2, -0.1]))
IN_WORLD = T_WORLD * TRUTH


def points(scans: list[int], check: tuple[int, ...] = (), truth: RigidTransform = IN_WORLD) -> list[ControlPoint]:
    """A point in each of these scans, known to 5 cm."""
    rng = np.random.default_rng(3)
    picked = {k: np.array([2.0, 1.0, -1.0]) + rng.normal(size=3) for k in scans}
    known = {k: truth[k].apply(place) + 0.05 * rng.normal(size=3) for k, place in picked.items()}
    use: dict[int, Use] = {k: "check" if k in check else "control" for k in scans}
    return [ControlPoint(f"P{k}", k, picked[k], known[k], np.full(3, 0.05), use[k]) for k in scans]


def halved(i: int, j: int, given: Registration) -> Registration:
    """Nothing joins the first twelve scans to the others."""
    return replace(given, accepted=False, probability=0.0, reason="too weak") if i <= 11 < j else given


@pytest.mark.slow
def test_points_place_a_map_in_the_world_without_registrations() -> None:
    registrar = KnowingRegistrar(TRUTH, 4 * COVARIANCE)
    alone = Mapper(registrar, VOXEL).run(SCANS)
    before, registrar.pairs = registrar.pairs, []
    held = Mapper(registrar, VOXEL).run(SCANS, control=points([0, 5, 9, 14, 19], check=(9,)))
    assert registrar.pairs == before
    assert error(alone, IN_WORLD) > 100
    assert error(held, IN_WORLD) < 0.25
    assert held.solution.graph.anchors == ()
    used = {each.point.name: each for each in held.control}
    assert max(np.linalg.norm(each.residual) for each in held.control) < 0.3
    assert used["P9"].point.use == "check"
    assert "P9" not in {each.name for each in held.solution.graph.control}
    assert all(each.in_world and not each.left_out for each in held.control)
    np.testing.assert_allclose(
        used["P5"].estimated, held.trajectory.T_world_sensor[5].apply(used["P5"].point.point), atol=1e-12
    )
    (component,) = held.maps
    assert np.abs(component.points.mean(axis=0) - IN_WORLD.translation.mean(axis=0)).max() < 8


@pytest.mark.slow
def test_check_points_do_not_move_a_map_that_navigation_places() -> None:
    sigmas = np.array([0.01, 0.01, 0.03, 0.5, 0.5, 0.1])
    priors = {k: PosePrior(IN_WORLD[k], sigmas) for k in range(0, 24, 3)}
    scans = [replace(scan, prior=priors.get(k)) for k, scan in enumerate(SCANS)]
    plain, checked = (
        Mapper(KnowingRegistrar(TRUTH, COVARIANCE), VOXEL).run(scans, control=control)
        for control in ([], points([1, 8, 16], check=(1, 8, 16)))
    )
    np.testing.assert_array_equal(
        plain.trajectory.T_world_sensor.as_matrix(), checked.trajectory.T_world_sensor.as_matrix()
    )
    assert all(each.in_world for each in checked.control)
    assert max(np.linalg.norm(each.residual) for each in checked.control) < 0.6
    lost = Mapper(KnowingRegistrar(TRUTH, COVARIANCE), VOXEL).run(SCANS, control=points([1, 8], check=(1, 8)))
    assert not any(each.in_world for each in lost.control)


@pytest.mark.slow
def test_points_of_scans_between_the_key_scans_count() -> None:
    dense = ring_poses(60, turns=0.5)
    truth = T_WORLD * dense
    settings = MapperSettings(LoopSettings(per_scan=0), keys=KeySettings(3.0))
    mapper = Mapper(KnowingRegistrar(dense, COVARIANCE), VOXEL, settings)
    scans = scans_of(dense)
    keys = mapper.run(scans).keys
    assert keys is not None
    between = [k for k in range(60) if k not in keys]
    control = points([between[1], keys[3], between[len(between) // 2], between[-2], keys[-2]], truth=truth)
    result = mapper.run(scans, control=control)
    assert result.keys == keys
    assert error(result, truth) < 0.5
    assert all(each.in_world for each in result.control)
    control[1] = replace(control[1], known=control[1].known + np.array([0.0, 20.0, 0.0]))
    named = mapper.run(scans, control=control)
    assert [each.point.scan for each in named.control if each.left_out] == [keys[3]]
    assert error(named, truth) < 0.8


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ({"ties": [Tie(2, 24, "reject")]}, "names scan 24; there are 24"),
        ({"ties": [Tie(2, 4, "reject"), Tie(2, 4, "accept")]}, "two ties"),
        ({"control": [replace(points([3])[0], scan=-1)]}, "there are 24"),
    ],
)
def test_ties_and_points_of_missing_scans_are_refused(inputs: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Mapper(KnowingRegistrar(TRUTH, COVARIANCE), VOXEL).run(SCANS, **inputs)


@pytest.mark.slow
def test_a_false_tie_shows_its_contradiction_and_can_be_rejected():
    registrar = KnowingRegistrar(TRUTH, 4 * COVARIANCE)
    alone = mapped([], registrar)
    false = mapped([Tie(3, 17, "add", measured(3, 17, WRONG), "planted")], registrar)
    tied = pair_of(false, 3, 17)
    assert tied.kept
    assert (tied.by_hand, tied.note) == ("given", "planted")
    assert tied.contradicted > 300
    assert error(false) > 5 * error(alone)
    rejected = mapped([Tie(3, 17, "reject")], registrar)
    np.testing.assert_array_equal(
        rejected.trajectory.T_world_sensor.as_matrix(), alone.trajectory.T_world_sensor.as_matrix()
    )


@pytest.mark.slow
def test_ties_change_only_their_own_pairs() -> None:
    """Only the added pair is registered in addition."""
    plain, registrar = (KnowingRegistrar(TRUTH, COVARIANCE, with_false_loops) for _ in range(2))
    mapped([], plain)
    result = mapped([Tie(5, 6, "reject"), Tie(2, 21, "add")], registrar)
    assert set(registrar.pairs) - set(plain.pairs) <= {(2, 21)}
    assert (5, 6) in result.gaps
    assert len(result.components) == 1


@pytest.mark.slow
def test_a_tie_keeps_the_answer_that_the_survey_takes():
    """The more probable answer of (2, 21) is wrong, and the survey takes the other, with the tie as well."""

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


@pytest.mark.slow
def test_parts_placed_by_points_share_the_world() -> None:
    def run(control: list[ControlPoint], *ties: Tie) -> SurveyResult:
        return Mapper(KnowingRegistrar(TRUTH, COVARIANCE, halved), VOXEL).run(SCANS, control=control, ties=ties)

    assert len(run([]).components) == 2
    whole = run(points([0, 4, 9, 13, 17, 22]))
    assert whole.components == (tuple(range(24)),)
    assert error(whole, IN_WORLD) < 0.3
    lacking = run(points([0, 4, 9, 17]))
    assert len(lacking.components) == 2
    assert lacking.solution.graph.gauge.unmeasured.keys() == {12}
    first = lacking.trajectory.take(range(12)).T_world_sensor.translation
    assert np.linalg.norm(first - IN_WORLD[:12].translation, axis=1).max() < 0.4
    joined = run(points([0, 4, 9]), Tie(10, 13, "add"))
    assert len(joined.components) == 1
    assert error(joined, IN_WORLD) < 1.0
