"""The mapper with a registrar that knows the truth: chains, gaps, bridges, loops, false loops."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.graph.trajectory import chain
from sonarmap.slam.loops.candidates import find_candidates
from sonarmap.slam.loops.settings import LoopSettings
from sonarmap.slam.map.cell import outline
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.pair import Pair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of

VOXEL = 0.5
NO_LOOPS = MapperSettings(loops=LoopSettings(per_scan=0))
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)


def refuse(given: Registration) -> Registration:
    return replace(given, accepted=False, reason="too weak")


def position_error(result: SurveyResult, truth: RigidTransform) -> float:
    """Root mean square over the poses [m]; the truth begins at the identity, as components do."""
    difference = result.trajectory.T_world_sensor.translation - truth.translation
    return float(np.sqrt((difference**2).sum(axis=1).mean()))


def tried(result: SurveyResult, role: str) -> list[Pair]:
    return [pair for pair in result.pairs if pair.role == role]


def test_a_chain_without_loops_is_the_chain():
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


def test_loops_close_the_ring_and_lower_the_error():
    truth = ring_poses(24)
    scans = scans_of(truth)
    errors = []
    for settings in (NO_LOOPS, MapperSettings()):
        result = Mapper(KnowingRegistrar(truth, 4 * COVARIANCE), VOXEL, settings).run(scans)
        errors.append(position_error(result, truth))
    assert errors[1] < 0.7 * errors[0]
    loops = tried(result, "loop")
    assert any(pair.i < 3 and pair.j > 20 for pair in loops if pair.kept)
    assert all(pair.kept and "sigmas from the final poses" in pair.reason for pair in loops)
    assert all(pair.predicted_overlap >= 0.1 and pair.residual < 5 for pair in loops)
    partners = np.bincount([index for pair in loops for index in (pair.i, pair.j)])
    assert partners.max() <= 4  # two rounds of two
    assert result.solution.chi_squared_after < result.solution.chi_squared_before


def test_a_false_loop_is_refused_in_words():
    truth = ring_poses(24)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        if j - i < 20:
            return given
        wrong = RigidTransform.from_exp_coords([0, 0, 0.5, 3.0, 0, 0])
        return replace(given, T_target_source=given.T_target_source * wrong)

    result = Mapper(KnowingRegistrar(truth, COVARIANCE, spoil), VOXEL).run(scans_of(truth))
    false = [pair for pair in tried(result, "loop") if pair.j - pair.i >= 20]
    assert false
    for pair in false:
        assert not pair.kept
        assert pair.reason.startswith("refused, inconsistent")
        assert pair.sigmas_from_estimate > 4.74
        assert pair.residual > 4.74
    assert any(pair.kept for pair in tried(result, "loop"))
    assert position_error(result, truth) < 0.5


def test_an_unusable_scan_is_bridged_and_stays_apart():
    truth = ring_poses(10, turns=0.5)
    registrar = KnowingRegistrar(truth, COVARIANCE, broken=("scan4",))
    result = Mapper(registrar, VOXEL, NO_LOOPS).run(scans_of(truth))
    assert result.gaps == ((3, 4), (4, 5))
    assert result.components == ((0, 1, 2, 3, 5, 6, 7, 8, 9), (4,))
    assert [(pair.i, pair.j) for pair in tried(result, "bridge") if pair.kept] == [(3, 5)]
    assert "scan4: it is of no use" in next(pair.reason for pair in result.pairs if pair.i == 4)
    # The pose of the scan that stands alone is its own origin, and its map is its own points.
    np.testing.assert_allclose(result.trajectory.T_world_sensor[4].as_matrix(), np.eye(4), atol=1e-9)
    assert set(result.maps[1].scan.tolist()) == {4}
    assert 4 not in result.maps[0].scan


def test_a_gap_that_nothing_bridges_leaves_two_maps():
    truth = ring_poses(9, turns=0.5)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return refuse(given) if i <= 3 < j else given

    result = Mapper(KnowingRegistrar(truth, COVARIANCE, spoil), VOXEL).run(scans_of(truth))
    assert result.gaps == ((3, 4),)
    assert result.components == ((0, 1, 2, 3), (4, 5, 6, 7, 8))
    assert len(tried(result, "bridge")) == 5  # two pairs two apart, three pairs three apart
    assert all(pair.j <= 3 or pair.i >= 4 for pair in tried(result, "loop"))
    second = result.trajectory.take(result.components[1]).T_world_sensor
    wanted = (truth[4].inv() * truth[4:]).as_matrix()
    np.testing.assert_allclose(second.as_matrix(), wanted, atol=0.3)
    assert result.solution.graph.anchors == (0, 4)
    assert all(set(m.scan.tolist()) <= set(c) for m, c in zip(result.maps, result.components, strict=True))


def test_a_covariance_that_is_none_fails_its_pair():
    truth = ring_poses(4, turns=0.2)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, covariance=np.zeros((6, 6))) if (i, j) == (1, 2) else given

    settings = MapperSettings(loops=LoopSettings(per_scan=0), bridge=1)
    result = Mapper(KnowingRegistrar(truth, COVARIANCE, spoil), VOXEL, settings).run(scans_of(truth))
    assert result.gaps == ((1, 2),)
    assert "positive definite" in result.pairs[1].reason


def test_holds_few_prepared_scans_and_frees_them():
    truth = ring_poses(24)
    registrar = KnowingRegistrar(truth, COVARIANCE)
    Mapper(registrar, VOXEL, MapperSettings(prepared=3)).run(scans_of(truth))
    assert registrar.most_alive <= 4
    assert registrar.alive == 0
    assert max(registrar.prepared.values()) <= 6


def test_progress_counts_up_to_its_plan():
    truth = ring_poses(12)
    said: list[tuple[int, int, str]] = []
    result = Mapper(KnowingRegistrar(truth, COVARIANCE), VOXEL).run(
        scans_of(truth), lambda done, total, words: said.append((done, total, words))
    )
    assert [done for done, _, _ in said] == list(range(1, len(result.pairs) + 3))
    assert all(done <= total for done, total, _ in said)
    assert said[-1][0] == said[-1][1]
    assert said[0][2].startswith("scan0 - scan1: accepted")


def test_all_pairs_failing_is_an_error_but_all_refused_is_a_result():
    truth = ring_poses(3, turns=0.1)
    scans = scans_of(truth)

    def too_flat(i: int, j: int, given: Registration) -> Registration:
        raise InputError("all in one plane")

    with pytest.raises(InputError, match=r"none of the 3 pairs .* all in one plane"):
        Mapper(KnowingRegistrar(truth, COVARIANCE, too_flat), VOXEL).run(scans)
    result = Mapper(KnowingRegistrar(truth, COVARIANCE, lambda i, j, r: refuse(r)), VOXEL).run(scans)
    assert result.components == ((0,), (1,), (2,))
    assert len(result.maps) == 3


def test_a_machine_that_fails_is_no_pair_that_fails():
    """Else a map would depend on what else the machine had to do."""
    truth = ring_poses(3, turns=0.1)

    def too_large(i: int, j: int, given: Registration) -> Registration:
        raise DeviceError("this needs 9 GiB")

    with pytest.raises(DeviceError, match="9 GiB"):
        Mapper(KnowingRegistrar(truth, COVARIANCE, too_large), VOXEL).run(scans_of(truth))


@pytest.mark.parametrize("fault", [DeviceError("this needs 9 GiB"), KeyboardInterrupt()])
def test_however_it_ends_the_prepared_scans_are_released(fault: BaseException) -> None:
    """Else a program that goes on, as a notebook does, has no device memory left for the next."""
    truth, released = ring_poses(3, turns=0.1), list[bool]()

    class Noted(Worker):
        def release(self) -> None:
            released.append(True)
            super().release()

    def fail(i: int, j: int, given: Registration) -> Registration:
        raise fault

    registrar = KnowingRegistrar(truth, COVARIANCE, fail)
    with pytest.raises(type(fault)):
        Mapper(registrar, VOXEL, execution=Execution(Noted(registrar, 3))).run(scans_of(truth))
    assert released == [True]


@pytest.mark.parametrize("count", [0, 1])
def test_one_scan_is_no_survey(count):
    truth = ring_poses(2)
    with pytest.raises(InputError, match="at least two"):
        Mapper(KnowingRegistrar(truth, COVARIANCE), VOXEL).run(scans_of(truth)[:count])


@pytest.mark.parametrize(
    "make",
    [
        lambda: Mapper(KnowingRegistrar(ring_poses(2), COVARIANCE), 0.0),
        lambda: MapperSettings(prepared=1),
        lambda: MapperSettings(map_voxel=-1.0),
        lambda: LoopSettings(min_overlap=0.0),
        lambda: LoopSettings(per_scan=-1),
        lambda: LoopSettings(bound=0.0),
    ],
)
def test_settings_refuse_what_makes_no_sense(make):
    with pytest.raises(InputError):
        make()


def test_candidates_spread_and_skip_what_is_joined():
    truth = ring_poses(24)
    scans = scans_of(truth)
    result = Mapper(KnowingRegistrar(truth, COVARIANCE), VOXEL, NO_LOOPS).run(scans)
    settings = LoopSettings(per_scan=3, min_overlap=0.2, spread=2)
    outlines = [outline(scan, settings.cell_voxels * VOXEL) for scan in scans]
    found = find_candidates(outlines, result.solution, VOXEL, settings)
    # half a ring apart along the chain, yet neighbors on its other side
    assert found[0].j - found[0].i > 12
    for index in range(24):
        partners = sorted(c.i + c.j - index for c in found if index in (c.i, c.j))
        assert len(partners) <= 3
        assert (np.diff(partners) > 2).all()
        assert index + 1 not in partners


def test_later_rounds_seek_only_what_the_estimate_knows_no_better_than_registrations():
    """The ends of a chain that closes no loop are unsure of each other; with many loops nothing is left to gain."""
    truth = ring_poses(24)
    scans = scans_of(truth)
    settings = LoopSettings()
    outlines = [outline(scan, settings.cell_voxels * VOXEL) for scan in scans]
    chained = Mapper(KnowingRegistrar(truth, COVARIANCE), VOXEL, NO_LOOPS).run(scans)
    unsure = find_candidates(outlines, chained.solution, VOXEL, settings, unsure=True)
    assert any(pair.j - pair.i > 20 for pair in unsure)
    registrar = KnowingRegistrar(truth, COVARIANCE)
    looped = Mapper(registrar, VOXEL, MapperSettings(loops=LoopSettings(per_scan=6, spread=0, rounds=4))).run(scans)
    assert len(find_candidates(outlines, looped.solution, VOXEL, settings)) > 10
    assert not find_candidates(outlines, looped.solution, VOXEL, settings, unsure=True)
    with pytest.raises(InputError, match="most_rounds 1: wanted at least the 2 of rounds"):
        LoopSettings(most_rounds=1)
