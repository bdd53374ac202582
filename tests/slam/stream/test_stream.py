"""Dense streams: few key scans, and every scan in the map."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.loops.settings import LoopSettings
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.slam.stream.keys import KeySettings, choose_keys
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of

VOXEL, COUNT = 0.2, 160
COVARIANCE = random_covariance(np.random.default_rng(0), 0.001, 0.01)
# a step of 0.1 m and 1 degree: a third of a circle
STREAM = ring_poses(COUNT, radius=6.0, turns=COUNT / 360)
SCANS = scans_of(STREAM, reach=4.0)


def way(i: int, j: int) -> float:
    return float(np.linalg.norm((STREAM[i].inv() * STREAM[j]).translation))


def reach(i: int, j: int, given: Registration) -> Registration:
    """What scans share falls with the way between them; none are registered over more than 1.5 m."""
    near = way(i, j) < 1.5
    return replace(given, overlap=max(0.0, 1 - way(i, j) / 4), accepted=near, probability=0.95 if near else 0.1)


def mapped(
    scans: list[Scan] | None = None,
    step: float | None = None,
    odometry: Odometry | None = None,
    spoil: Callable[[int, int, Registration], Registration] = reach,
) -> tuple[SurveyResult, KnowingRegistrar]:
    registrar = KnowingRegistrar(STREAM, COVARIANCE, spoil)
    settings = MapperSettings(LoopSettings(per_scan=1, rounds=1, most_rounds=1), keys=KeySettings(step))
    return Mapper(registrar, VOXEL, settings).run(scans or SCANS, odometry=odometry), registrar


def largest_error(result: SurveyResult) -> float:
    away = result.trajectory.T_world_sensor.translation - STREAM.translation
    return float(np.linalg.norm(away, axis=1).max())


def test_few_scans_are_registered_and_all_are_placed() -> None:
    result, registrar = mapped()
    assert result.keys is not None
    assert result.keys[0] == 0
    assert result.keys[-1] == COUNT - 1
    assert len(result.keys) < COUNT / 5
    assert len(registrar.pairs) < COUNT / 2
    assert result.components == (tuple(range(COUNT)),)
    assert largest_error(result) < 0.3
    assert result.by_navigation == ()
    assert {scan for pair in result.pairs for scan in pair.scans} <= set(result.keys)
    assert result.covariances.shape == (COUNT, 6, 6)

    # a scan between is less sure than its key scans
    a, b = max(zip(result.keys[5:], result.keys[6:], strict=False), key=lambda pair: pair[1] - pair[0])
    traces = np.trace(result.covariances[:, 3:, 3:], axis1=1, axis2=2)
    assert traces[(a + b) // 2] > traces[a]


def test_a_user_may_set_the_step() -> None:
    result, _ = mapped(step=0.5)
    assert result.keys is not None
    ways = np.linalg.norm(np.diff(STREAM.translation[list(result.keys)], axis=0), axis=1)
    assert 0.25 < np.median(ways) < 0.6
    with pytest.raises(InputError, match="key_step"):
        KeySettings(0.0)


def test_refused_strides_are_halved() -> None:
    def short(i: int, j: int, given: Registration) -> Registration:
        return reach(i, j, given) if j - i <= 3 else replace(given, accepted=False, probability=0.0)

    result, _ = mapped(spoil=short)
    assert result.keys is not None
    assert max(np.diff(result.keys)) <= 3
    assert largest_error(result) < 0.4


def test_strides_go_on_along_a_wall() -> None:
    """A direction that scans leave open is so at half the way as well; a wrong place is not."""

    def along(place: float) -> Callable[[int, int, Registration], Registration]:
        def spoil(i: int, j: int, given: Registration) -> Registration:
            beside_the_wall = i >= COUNT // 3 and j < 2 * COUNT // 3
            if not beside_the_wall:
                return reach(i, j, given)
            loose = np.diag([1e-6, 1e-6, 1e-6, 100.0, 1e-4, 1e-4])
            return replace(given, covariance=loose, accepted=False, probability=0.1 * place, evidence=(("held", 0.1),))

        return spoil

    def strides(place: float) -> np.ndarray:
        runner = PairRunner(Execution.here(KnowingRegistrar(STREAM, COVARIANCE, along(place)), 2), SCANS, 2, None)
        keys, _ = choose_keys(runner, np.zeros(COUNT, np.intp), VOXEL, KeySettings())
        return np.diff([k for k in keys if COUNT // 3 <= k < 2 * COUNT // 3])

    assert max(strides(place=0.3)) == 1
    assert min(strides(place=0.95)) > 3


@pytest.mark.parametrize("widest", [1.5, 0.6])
def test_idle_workers_register_ahead_and_the_key_scans_are_the_same(widest: float) -> None:
    """Also where many strides are refused."""

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return reach(i, j, given) if way(i, j) < widest else replace(given, accepted=False, probability=0.0)

    def searched(workers: int) -> tuple[list[int], list[tuple[int, int]], list[int]]:
        here = Execution.here(KnowingRegistrar(STREAM, COVARIANCE, spoil), 2)
        executor = replace(here.executor, worker_count=lambda: workers)
        runner, at_a_time = PairRunner(replace(here, executor=executor), SCANS, 2, None), list[int]()
        register = runner.register

        def counted(candidates: Sequence[Candidate]) -> list[RegisteredPair]:
            at_a_time.append(len(candidates))
            return register(candidates)

        runner.register = counted
        keys, pairs = choose_keys(runner, np.zeros(COUNT, np.intp), VOXEL, KeySettings())
        return keys, [pair.scans for pair in pairs], at_a_time[1:]  # the probes are registered together

    keys, pairs, alone = searched(workers=1)
    assert set(alone) == {1}
    for workers in (3, 100):
        others_keys, others_pairs, at_a_time = searched(workers)
        assert (others_keys, others_pairs) == (keys, pairs)
        assert max(at_a_time) <= 4
        assert len(at_a_time) < len(alone) / 1.5


def test_a_survey_that_is_no_stream_is_registered_scan_by_scan() -> None:
    """What was tried to find out is not tried again."""
    sparse = ring_poses(48)
    registrar = KnowingRegistrar(sparse, COVARIANCE)
    result = Mapper(registrar, VOXEL, MapperSettings(LoopSettings(per_scan=0))).run(scans_of(sparse))
    assert result.keys is None
    assert sorted(registrar.pairs) == [(k, k + 1) for k in range(47)]


def test_fixes_of_scans_between_place_the_map() -> None:
    world = RigidTransform.from_exp_coords([0, 0, 1.2, 300.0, -200.0, -15.0])
    sigmas = np.array([np.inf, np.inf, np.inf, 0.1, 0.1, 0.05])
    scans = [
        replace(scan, prior=PosePrior(world * STREAM[k], sigmas)) if k % 10 == 7 else scan
        for k, scan in enumerate(SCANS)
    ]
    result, _ = mapped(scans)
    assert result.keys is not None
    away = result.trajectory.T_world_sensor.translation - (world * STREAM).translation
    assert np.linalg.norm(away, axis=1).max() < 0.5


def test_a_wrong_fix_that_dead_reckoning_shows_is_told() -> None:
    sigmas = np.array([np.inf, np.inf, np.inf, 0.2, 0.2, 0.1])
    scans = [
        replace(scan, prior=PosePrior(RigidTransform.from_translation([20.0 * (k == 70), 0, 0]) * STREAM[k], sigmas))
        for k, scan in enumerate(SCANS)
    ]
    result, _ = mapped(scans, odometry=Odometry(np.arange(COUNT), STREAM, 100.0 + np.arange(COUNT)))
    assert result.keys is not None
    assert [(fix.scan, fix.kind) for fix in result.wrong_fixes] == [(70, "position")]


@pytest.mark.slow
def test_dead_reckoning_places_what_a_steady_motion_does_not() -> None:
    """The vehicle shakes from scan to scan; its log knows."""
    shake = 0.05 * np.sin(2.5 * np.arange(COUNT))
    shaken = STREAM * RigidTransform.from_translation(np.outer(shake, [0, 0, 1.0]))
    registrar = KnowingRegistrar(shaken, COVARIANCE, reach)
    odometry = Odometry(np.arange(COUNT), shaken, 100.0 + np.arange(COUNT))
    settings = MapperSettings(LoopSettings(per_scan=0))
    errors = []
    for told in (None, odometry):
        result = Mapper(registrar, VOXEL, settings).run(SCANS, odometry=told)
        T = result.trajectory.T_world_sensor
        off = (T[:-1].inv() * T[1:]).translation - (shaken[:-1].inv() * shaken[1:]).translation
        errors.append(float(np.sqrt((off**2).sum(axis=1).mean())))
    assert errors[1] < 0.5 * errors[0]
