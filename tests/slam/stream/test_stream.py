"""Dense streams: few key scans, and every scan registered to one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.slam.stream.keys import KeySettings, choose_keys
from sonarmap.slam.stream.refine import Between, refine
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.surveys import KnowingRegistrar, random_covariance, registration, ring_poses, scans_of

VOXEL, COUNT = 0.2, 160
COVARIANCE = random_covariance(np.random.default_rng(0), 0.001, 0.01)
# a step of 0.1 m and 1 degree: a third of a circle
STREAM = ring_poses(COUNT, radius=6.0, turns=COUNT / 360)
SCANS = scans_of(STREAM, reach=4.0)


def distance(i: int, j: int) -> float:
    return float(np.linalg.norm((STREAM[i].inv() * STREAM[j]).translation))


def reach(i: int, j: int, given: Registration) -> Registration:
    """Overlap falls with distance; pairs more than 1.5 m apart are refused."""
    near = distance(i, j) < 1.5
    return replace(given, overlap=max(0.0, 1 - distance(i, j) / 4), accepted=near, probability=0.95 if near else 0.1)


def mapped(
    scans: list[Scan] | None = None,
    step: float | None = None,
    spoil: Callable[[int, int, Registration], Registration] = reach,
) -> tuple[SurveyResult, KnowingRegistrar]:
    registrar = KnowingRegistrar(STREAM, COVARIANCE, spoil)
    settings = MapperSettings(LoopSettings(per_scan=1, rounds=1, most_rounds=1), keys=KeySettings(step))
    return Mapper(registrar, VOXEL, settings).run(scans or SCANS), registrar


def largest_error(result: SurveyResult) -> float:
    away = result.trajectory.T_world_sensor.translation - STREAM.translation
    return float(np.linalg.norm(away, axis=1).max())


@pytest.mark.slow
def test_few_pairs_are_registered_and_all_scans_are_placed() -> None:
    result, registrar = mapped()
    assert result.keys is not None
    assert result.keys[0] == 0
    assert result.keys[-1] == COUNT - 1
    assert len(result.keys) < COUNT / 5
    assert len(registrar.pairs) < COUNT + 2 * len(result.keys)  # each scan once, key scans with loops
    assert result.interpolated == ()
    assert result.components == (tuple(range(COUNT)),)
    assert largest_error(result) < 0.3
    assert result.by_navigation == ()
    assert {scan for pair in result.pairs for scan in pair.scans} <= set(result.keys)
    assert result.covariances.shape == (COUNT, 6, 6)


def off_its_neighbors(result: SurveyResult, k: int) -> float:
    """Error of a scan's position relative to the scan before it [m]."""
    T = result.trajectory.T_world_sensor
    return float(np.linalg.norm((T[k - 1].inv() * T[k]).translation - (STREAM[k - 1].inv() * STREAM[k]).translation))


@pytest.mark.slow
def test_scans_without_a_usable_registration_are_interpolated() -> None:
    """One scan is refused with both key scans, another is registered to a place 1 m off by both."""
    refused, wrong = 40, 70
    off = RigidTransform.from_translation([0.6, -0.7, 0.4])

    def spoil(i: int, j: int, given: Registration) -> Registration:
        given = reach(i, j, given)
        if refused in (i, j):
            return replace(given, accepted=False, probability=0.2)
        if wrong in (i, j):
            T = given.T_target_source
            return replace(given, T_target_source=T * off if j == wrong else off.inv() * T)
        return given

    result, registrar = mapped(spoil=spoil)
    assert result.keys is not None
    assert not {refused, wrong} & set(result.keys)
    assert result.interpolated == (refused, wrong)
    assert all(sum(k in pair for pair in registrar.pairs) == 2 for k in result.interpolated)
    assert max(off_its_neighbors(result, k) for k in result.interpolated) < 0.1
    # registered scans are more certain
    traces = np.trace(result.covariances[:, 3:, 3:], axis1=1, axis2=2)
    assert traces[refused] > traces[refused - 1]


def test_a_jump_is_between_two_key_scans() -> None:
    jump = COUNT // 2
    T = RigidTransform.concatenate([STREAM[:jump], RigidTransform.from_translation([0.0, 0, 2.0]) * STREAM[jump:]])

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, overlap=1 - distance(i, j) / 4)

    runner = PairRunner(Execution(Worker(KnowingRegistrar(T, COVARIANCE, spoil), 2)), SCANS, 2, None)
    keys, pairs = choose_keys(runner, np.zeros(COUNT, np.intp), VOXEL, KeySettings())
    assert {jump - 1, jump} <= set(keys)
    assert len(keys) < COUNT / 5
    assert [pair.scans for pair in pairs] == list(pairwise(keys))


def test_a_scan_may_leave_the_motion_as_the_scan_beside_it_does() -> None:
    """Between key scans 0 and 6 the sensor jumps before scan 3; scan 1 alone is registered to a place 1 m off."""
    jumps = dict(zip(range(1, 6), [1.0, 0.0, 2.0, 2.0, 2.0], strict=True))
    floor, scans = np.full(6, 0.01), list[Between]()
    for k in jumps:
        # the expected pose of scan 3 alone is so uncertain that its registration agrees
        expected = registration(RigidTransform.from_translation([k, 0, 0]), (1.0 if k == 3 else 1e-4) * np.eye(6))
        scans.append(Between(k, Edge(0, k, expected, "odometry"), 6, RigidTransform.from_translation([6.0, 0, 0])))

    class Runner:
        def register(self, candidates: Sequence[Candidate]) -> list[RegisteredPair]:
            places = {0: 0.0, 6: 0.0} | jumps
            return [
                c.registered(
                    registration(
                        RigidTransform.from_translation([c.j - c.i, places[c.j] - places[c.i], 0]), 1e-4 * np.eye(6)
                    )
                )
                for c in candidates
            ]

    edges = refine(cast(PairRunner, Runner()), scans, floor, 4.74)
    assert sorted(edges) == [2, 3, 4, 5]


def test_idle_workers_register_ahead_and_the_key_scans_are_the_same() -> None:
    """Also if many strides are refused."""
    widest = 0.6

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return reach(i, j, given) if distance(i, j) < widest else replace(given, accepted=False, probability=0.0)

    def searched(workers: int) -> tuple[list[int], list[tuple[int, int]], list[int]]:
        here = Execution(Worker(KnowingRegistrar(STREAM, COVARIANCE, spoil), 2))
        executor = replace(here.executor, workers=workers)
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


@pytest.mark.slow
def test_fixes_of_scans_between_key_scans_place_the_map() -> None:
    world = RigidTransform.from_exp_coords([0, 0, 1.2, 300.0, -200.0, -15.0])
    sigmas = np.array([np.inf, np.inf, np.inf, 0.1, 0.1, 0.05])
    priors = {k: PosePrior(world * STREAM[k], sigmas) for k in range(7, COUNT, 10)}
    scans = [replace(scan, prior=priors.get(k)) for k, scan in enumerate(SCANS)]
    result, _ = mapped(scans)
    assert result.keys is not None
    away = result.trajectory.T_world_sensor.translation - (world * STREAM).translation
    assert np.linalg.norm(away, axis=1).max() < 0.5


@pytest.mark.slow
def test_dead_reckoning_joins_scans_that_cannot_be_registered() -> None:
    def spoil(i: int, j: int, given: Registration) -> Registration:
        return given if i < 3 else replace(given, accepted=False, probability=0.0)

    odometry = Odometry(np.arange(COUNT), STREAM, 100.0 + np.arange(COUNT))
    settings = MapperSettings(LoopSettings(per_scan=0))
    result = Mapper(KnowingRegistrar(STREAM, COVARIANCE, spoil), VOXEL, settings).run(SCANS, odometry=odometry)
    assert result.components == (tuple(range(COUNT)),)
    assert largest_error(result) < 0.3


@pytest.mark.slow
def test_registrations_or_dead_reckoning_follow_a_shaken_sensor() -> None:
    shake = 0.05 * np.sin(2.5 * np.arange(COUNT))
    shaken = STREAM * RigidTransform.from_translation(np.outer(shake, [0, 0, 1.0]))
    odometry = Odometry(np.arange(COUNT), shaken, 100.0 + np.arange(COUNT))
    settings = MapperSettings(LoopSettings(per_scan=0))

    def error(
        given: Odometry | None, spoil: Callable[[int, int, Registration], Registration] = reach
    ) -> tuple[float, set[int]]:
        result = Mapper(KnowingRegistrar(shaken, COVARIANCE, spoil), VOXEL, settings).run(SCANS, odometry=given)
        T = result.trajectory.T_world_sensor
        off = (T[:-1].inv() * T[1:]).translation - (shaken[:-1].inv() * shaken[1:]).translation
        return float(np.sqrt((off**2).sum(axis=1).mean())), set(result.keys or ())

    followed, keys = error(None)

    def keys_alone(i: int, j: int, given: Registration) -> Registration:
        """Refuse the scans between key scans; the key scans stay the same."""
        is_probe = j == i + 1 and j - 1 not in keys
        return reach(i, j, given) if is_probe or {i, j} <= keys else replace(given, accepted=False, probability=0.0)

    steady, same = error(None, keys_alone)
    assert same == keys
    assert followed < 0.6 * steady
    assert error(odometry, keys_alone)[0] < 0.6 * steady


@pytest.mark.slow
def test_a_stream_with_many_refused_probes_is_a_stream() -> None:
    """Four of the seven probes are refused; pairs farther apart are not."""
    tried = np.unique(np.linspace(0, COUNT - 2, 7).astype(int))[::2].tolist()

    def spoil(i: int, j: int, given: Registration) -> Registration:
        given = reach(i, j, given)
        return replace(given, accepted=False, probability=0.2) if i in tried and j == i + 1 else given

    result, registrar = mapped(spoil=spoil)
    assert {(k, k + 1) for k in tried} <= set(registrar.pairs)
    assert result.keys is not None
    assert len(result.keys) < COUNT / 5


@pytest.mark.slow
def test_a_survey_that_is_no_stream_is_registered_scan_by_scan() -> None:
    """The probes are not registered again."""
    sparse = ring_poses(48)
    registrar = KnowingRegistrar(sparse, COVARIANCE)
    result = Mapper(registrar, VOXEL, MapperSettings(LoopSettings(per_scan=0))).run(scans_of(sparse))
    assert result.keys is None
    assert sorted(registrar.pairs) == [(k, k + 1) for k in range(47)]


@pytest.mark.slow
def test_step_setting_gives_the_distance_between_key_scans() -> None:
    result, _ = mapped(step=0.5)
    assert result.keys is not None
    distances = np.linalg.norm(np.diff(STREAM.translation[list(result.keys)], axis=0), axis=1)
    assert 0.25 < np.median(distances) < 0.6
    with pytest.raises(InputError, match="key_step"):
        KeySettings(0.0)


@pytest.mark.slow
def test_strides_stay_long_along_a_wall() -> None:
    """An unconstrained direction does not shorten the stride, a wrong place does."""

    def along(place: float, i: int, j: int, given: Registration) -> Registration:
        if i < COUNT // 3 or j >= 2 * COUNT // 3:
            return reach(i, j, given)
        loose = np.diag([1e-6, 1e-6, 1e-6, 100.0, 1e-4, 1e-4])
        return replace(given, covariance=loose, accepted=False, probability=place, evidence=(("fixed", 0.1),))

    def strides(place: float) -> np.ndarray:
        registrar = KnowingRegistrar(STREAM, COVARIANCE, partial(along, place))
        runner = PairRunner(Execution(Worker(registrar, 2)), SCANS, 2, None)
        keys, _ = choose_keys(runner, np.zeros(COUNT, np.intp), VOXEL, KeySettings())
        return np.diff([k for k in keys if COUNT // 3 <= k < 2 * COUNT // 3])

    assert max(strides(place=0.3)) == 1
    assert min(strides(place=0.95)) > 3
