"""The mapper with a registrar that knows the truth: chains, gaps, bridges, loops, false loops, navigation."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.slam.candidates.candidates import find_candidates
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.graph.trajectory import chain
from sonarmap.slam.map.cell import outline
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.pair import Pair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.geometry import rotated
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import unexact
from tests.samples.surveys import (
    KnowingRegistrar,
    chain_edges,
    chained_graph,
    edge,
    position_error,
    random_covariance,
    ring_poses,
    scans_of,
)

VOXEL = 0.5
NO_LOOPS = MapperSettings(loops=LoopSettings(per_scan=0))
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)


def refuse(given: Registration) -> Registration:
    return replace(given, accepted=False, reason="too weak")


def raising(fault: BaseException) -> Callable[[int, int, Registration], Registration]:
    def spoil(i: int, j: int, given: Registration) -> Registration:
        raise fault

    return spoil


def error(result: SurveyResult, truth: RigidTransform) -> float:
    """Error of the positions [m]; the truth begins at the identity, as components do."""
    return position_error(result.trajectory.T_world_sensor, truth)


def mapped(truth: RigidTransform, settings: MapperSettings | None = None, spoil: Any = None) -> SurveyResult:
    return Mapper(KnowingRegistrar(truth, COVARIANCE, spoil), VOXEL, settings).run(scans_of(truth))


def tried(result: SurveyResult, role: str) -> list[Pair]:
    return [pair for pair in result.pairs if pair.role == role]


def test_without_loops_the_result_is_the_chain():
    truth = ring_poses(8, turns=0.4)
    scans = scans_of(truth)
    registrar = KnowingRegistrar(truth, COVARIANCE)
    result = Mapper(registrar, VOXEL, NO_LOOPS).run(scans)
    assert registrar.pairs == [(k, k + 1) for k in range(7)]
    assert set(registrar.prepared.values()) == {1}
    assert result.components == (tuple(range(8)),)
    assert result.gaps == ()
    chained = chain(result.edges, result.trajectory.stamps).T_world_sensor
    np.testing.assert_allclose(result.trajectory.T_world_sensor.as_matrix(), chained.as_matrix(), atol=1e-7)
    np.testing.assert_array_equal(result.trajectory.stamps, 100.0 + np.arange(8))
    sigmas = np.sqrt(np.trace(result.covariances[:, 3:, 3:], axis1=1, axis2=2))
    assert (np.diff(sigmas) > 0).all()
    assert len(result.maps) == 1
    assert result.maps[0].seen.max() >= 3


def test_loops_close_a_ring_and_few_prepared_scans_are_held():
    truth = ring_poses(20)
    registrar, log = KnowingRegistrar(truth, 4 * COVARIANCE), list[tuple[int, int, str]]()
    result = Mapper(registrar, VOXEL, MapperSettings(prepared=3)).run(scans_of(truth), lambda *args: log.append(args))
    steps = [edge for edge in result.edges if edge.kind == "sequential"]
    assert error(result, truth) < 0.7 * position_error(chain(steps, np.zeros(20)).T_world_sensor, truth)
    loops = tried(result, "loop")
    assert any(pair.i < 3 and pair.j > 16 for pair in loops if pair.kept)
    assert all(pair.kept and pair.predicted_overlap >= 0.1 and pair.residual < 5 for pair in loops)
    partners = np.bincount([index for pair in loops for index in (pair.i, pair.j)])
    assert partners.max() <= 4  # two rounds of two
    assert result.solution.chi_squared_after < result.solution.chi_squared_before
    assert registrar.most_alive <= 4
    assert registrar.alive == 0
    assert max(registrar.prepared.values()) <= 6
    assert [done for done, _, _ in log] == list(range(1, len(result.pairs) + 3))
    assert all(done <= total for done, total, _ in log)
    assert log[-1][0] == log[-1][1]


def test_an_unusable_scan_is_bridged_and_stays_apart():
    truth = ring_poses(10, turns=0.5)
    registrar = KnowingRegistrar(truth, COVARIANCE, broken=("scan4",))
    result = Mapper(registrar, VOXEL, NO_LOOPS).run(scans_of(truth))
    assert result.gaps == ((3, 4), (4, 5))
    assert result.components == ((0, 1, 2, 3, 5, 6, 7, 8, 9), (4,))
    assert [(pair.i, pair.j) for pair in tried(result, "bridge") if pair.kept] == [(3, 5)]
    assert "scan4: it is of no use" in next(pair.reason for pair in result.pairs if pair.i == 4)
    # The scan that stands alone is at the origin, and its map has only its own points.
    np.testing.assert_allclose(result.trajectory.T_world_sensor[4].as_matrix(), np.eye(4), atol=1e-9)
    assert set(result.maps[1].scan.tolist()) == {4}
    assert 4 not in result.maps[0].scan


def test_a_gap_that_no_pair_bridges_leaves_two_maps():
    truth = ring_poses(9, turns=0.5)
    result = mapped(truth, NO_LOOPS, lambda i, j, given: refuse(given) if i <= 3 < j else given)
    assert result.gaps == ((3, 4),)
    assert result.components == ((0, 1, 2, 3), (4, 5, 6, 7, 8))
    assert len(tried(result, "bridge")) == 5  # two pairs two apart, three pairs three apart
    second = result.trajectory.take(result.components[1]).T_world_sensor
    wanted = (truth[4].inv() * truth[4:]).as_matrix()
    np.testing.assert_allclose(second.as_matrix(), wanted, atol=0.3)
    assert result.solution.graph.anchors == (0, 4)
    assert all(set(m.scan.tolist()) <= set(c) for m, c in zip(result.maps, result.components, strict=True))


def test_all_pairs_failing_is_an_error_but_all_refused_is_a_result():
    truth = ring_poses(3, turns=0.1)
    with pytest.raises(InputError, match=r"none of the 3 pairs .* all in one plane"):
        mapped(truth, spoil=raising(InputError("all in one plane")))
    result = mapped(truth, spoil=lambda i, j, given: refuse(given))
    assert result.components == ((0,), (1,), (2,))
    assert len(result.maps) == 3


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("fault", [DeviceError("this needs 9 GiB"), KeyboardInterrupt("stopped")])
def test_a_device_error_stops_the_survey_and_releases_prepared_scans(fault: BaseException) -> None:
    """Else a map would depend on the machine's load, and a notebook would run out of device memory."""
    truth, released = ring_poses(3, turns=0.1), list[bool]()

    class Noted(Worker):
        def release(self) -> None:
            released.append(True)
            super().release()

    registrar = KnowingRegistrar(truth, COVARIANCE, raising(fault))
    with pytest.raises(type(fault), match=str(fault)):
        Mapper(registrar, VOXEL, execution=Execution(Noted(registrar, 3))).run(scans_of(truth))
    assert released == [True]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Mapper(KnowingRegistrar(ring_poses(2), COVARIANCE), VOXEL).run([]), "at least two"),
        (lambda: Mapper(KnowingRegistrar(ring_poses(2), COVARIANCE), 0.0), None),
        (lambda: MapperSettings(map_voxel=-1.0), None),
        (lambda: LoopSettings(most_rounds=1), "most_rounds 1: wanted at least the 2 of rounds"),
    ],
)
def test_invalid_input_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_candidates_spread_and_skip_joined_pairs():
    truth = ring_poses(24)
    scans = scans_of(truth)
    solution = chained_graph(chain_edges(truth, COVARIANCE), 24).optimize()
    settings = LoopSettings(per_scan=3, min_overlap=0.2, spread=2)
    outlines = [outline(scan, settings.cell_voxels * VOXEL) for scan in scans]
    found = find_candidates(outlines, solution, VOXEL, settings)
    # half a ring apart along the chain, yet neighbors on its other side
    assert found[0].j - found[0].i > 12
    for index in range(24):
        partners = sorted(c.i + c.j - index for c in found if index in (c.i, c.j))
        assert len(partners) <= 3
        assert (np.diff(partners) > 2).all()
        assert index + 1 not in partners


def test_narrow_overlaps_are_candidates_where_instruments_measured_both_scans():
    truth = ring_poses(24)
    scans, sigmas = scans_of(truth), np.array([0.01, 0.01, 0.02, 0.05, 0.05, 0.05])
    solution = chained_graph(chain_edges(truth, COVARIANCE), 24).optimize()
    settings = LoopSettings(per_scan=24, min_overlap=0.6, spread=0)
    outlines = [outline(scan, settings.cell_voxels * VOXEL) for scan in scans]
    measured = tuple((k, PosePrior(truth[k], sigmas)) for k in range(0, 24, 2))
    known = replace(solution, graph=replace(solution.graph, priors=measured))
    usual, more = (find_candidates(outlines, each, VOXEL, settings) for each in (solution, known))
    narrow = [each for each in more if each.predicted_overlap < 0.6]
    assert narrow
    assert not any(each.i % 2 or each.j % 2 for each in narrow)
    assert min(each.predicted_overlap for each in narrow) >= 0.2
    assert all(each.predicted_overlap >= 0.6 for each in usual)


def test_later_rounds_try_only_uncertain_pairs():
    """The ends of an open chain are uncertain relative to each other; with many loops there is nothing to gain."""
    truth = ring_poses(24)
    scans = scans_of(truth)
    settings = LoopSettings()
    outlines = [outline(scan, settings.cell_voxels * VOXEL) for scan in scans]
    steps = chain_edges(truth, COVARIANCE)
    loops = [edge(k, j, truth[k].inv() * truth[j], COVARIANCE, "loop") for k in range(24) for j in range(k + 5, 24, 3)]
    chained, looped = (chained_graph(edges, 24).optimize() for edges in (steps, [*steps, *loops]))
    unsure = find_candidates(outlines, chained, VOXEL, settings, unsure=True)
    assert any(pair.j - pair.i > 20 for pair in unsure)
    assert len(find_candidates(outlines, looped, VOXEL, settings)) > 10
    assert not find_candidates(outlines, looped, VOXEL, settings, unsure=True)


SIGMAS = np.array([0.02, 0.02, 0.03, 0.6, 0.6, 0.1])


def in_world(truth: RigidTransform, sigmas: np.ndarray = SIGMAS) -> list[Scan]:
    """Scans with priors whose errors match their sigmas."""
    rng = np.random.default_rng(1)
    priors = [replace(unexact(T, rng, SIGMAS), sigmas=sigmas) for T in truth]
    return [replace(scan, prior=prior) for scan, prior in zip(scans_of(truth), priors, strict=True)]


def halved(i: int, j: int, given: Registration) -> Registration:
    return refuse(given) if i <= 3 < j else given


@pytest.fixture(scope="module")
def truth() -> RigidTransform:
    return ring_poses(9, turns=0.5)


def placed(truth: RigidTransform, sigmas: np.ndarray = SIGMAS, settings: MapperSettings | None = None) -> SurveyResult:
    return Mapper(KnowingRegistrar(truth, COVARIANCE, halved), VOXEL, settings).run(in_world(truth, sigmas))


@pytest.mark.slow
def test_navigation_joins_two_halves_without_registrations(truth: RigidTransform) -> None:
    result = placed(truth)
    assert result.components == (tuple(range(9)),)
    assert result.gaps == ((3, 4),)
    assert result.by_navigation == ()
    assert set(result.maps[0].scan.tolist()) == set(range(9))
    assert error(result, truth) < 0.5
    # without bridges, pairs between them are tried as loops: navigation expects them to overlap
    tried = placed(truth, settings=MapperSettings(bridge=1)).pairs
    assert any(pair.role == "loop" and pair.i <= 3 < pair.j for pair in tried)
    unknown = np.where([False, False, False, True, True, False], np.inf, SIGMAS)
    assert placed(truth, unknown).components == ((0, 1, 2, 3), (4, 5, 6, 7, 8))


@pytest.mark.slow
def test_navigation_refuses_the_only_registration_between_two_parts(
    truth: RigidTransform,
) -> None:
    def spoil(i: int, j: int, given: Registration) -> Registration:
        if (i, j) != (3, 4):
            return halved(i, j, given)
        wrong = RigidTransform.from_exp_coords([0, 0, 0.6, 12.0, 5.0, 0])
        return replace(given, T_target_source=given.T_target_source * wrong)

    result = Mapper(KnowingRegistrar(truth, COVARIANCE, spoil), VOXEL).run(in_world(truth))
    assert (3, 4) not in {(edge.i, edge.j) for edge in result.edges}
    assert error(result, truth) < 0.5


@pytest.mark.slow
def test_an_invalid_covariance_fails_its_pair():
    truth = ring_poses(4, turns=0.2)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, covariance=np.zeros((6, 6))) if (i, j) == (1, 2) else given

    result = mapped(truth, replace(NO_LOOPS, bridge=1), spoil)
    assert result.gaps == ((1, 2),)
    assert "positive definite" in result.pairs[1].reason


@pytest.mark.slow
def test_a_scan_without_registrations_lies_at_its_prior() -> None:
    truth = ring_poses(10, turns=0.5)
    scans = in_world(truth)
    result = Mapper(KnowingRegistrar(truth, COVARIANCE, broken=("scan4",)), VOXEL).run(scans)
    assert result.components == (tuple(range(10)),)
    assert result.by_navigation == (4,)
    assert 4 in result.maps[0].scan
    prior = scans[4].prior
    assert prior is not None
    off = result.trajectory.T_world_sensor[4].translation - prior.T_world_sensor.translation
    np.testing.assert_allclose(off, 0, atol=1e-4)


def test_a_single_scan_is_a_map_where_instruments_place_it() -> None:
    T = RigidTransform.from_components([40.0, -9.0, -3.0], Rotation.from_euler("ZYX", [0.9, -0.2, 0.1]))
    sigmas = np.array([0.01, 0.02, 0.03, 0.4, 0.5, 0.1])
    mapper = Mapper(KnowingRegistrar(ring_poses(1), COVARIANCE), VOXEL)
    points = np.random.default_rng(0).uniform(-3, 3, (200, 3)).astype(np.float32)
    scan = Scan(points, prior=PosePrior(T, sigmas), name="only")
    alone = mapper.run([scan])
    assert alone.components == ((0,),)
    np.testing.assert_allclose(alone.trajectory.T_world_sensor[0].as_matrix(), T.as_matrix(), atol=1e-9)
    world = rotated(T.rotation, alone.covariances[0])
    np.testing.assert_allclose(np.sqrt(np.diag(world)[3:]), sigmas[3:], rtol=1e-3)
    with pytest.raises(InputError, match="needs at least two that overlap, or one whose"):
        mapper.run([replace(scan, prior=PosePrior(T, np.append(sigmas[:5], np.inf)))])
