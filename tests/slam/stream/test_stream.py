"""Dense streams: few key scans, every scan registered to one, and the deviations from a steady motion."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.slam.stream.between import Unsteadiness
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
    """One scan is refused with both key scans, of another every registration is wrong."""
    refused, wrong = 40, 70
    rng = np.random.default_rng(8)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        given = reach(i, j, given)
        if refused in (i, j):
            return replace(given, accepted=False, probability=0.2)
        if wrong in (i, j):
            T = RigidTransform.from_translation(rng.uniform(0.5, 1.0, 3)) * given.T_target_source
            return replace(given, T_target_source=T)
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


SHAKE = np.array([0.03, 0.01, 0.02, 0.02, 0.05, 0.01])
STRIDE = 10  # scans from one key scan to the next


def swinging(count: int, turn: float, shake: np.ndarray, seed: int = 2) -> RigidTransform:
    """Poses a decimeter apart along a swinging course that turns by at most `turn` per scan [rad]."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(turn * np.sin(2 * np.pi * np.arange(count) / 150))
    places = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(count)]), axis=0)
    smooth = RigidTransform.from_components(places, Rotation.from_euler("z", heading[:, None]))
    return smooth * RigidTransform.from_exp_coords(shake * rng.standard_normal((count, 6)))


def between(T: RigidTransform, offset: int) -> np.ndarray:
    """(N, 6) deviations of the scans `offset` after key scans from a steady motion to the next one."""
    first, last = T[:-1:STRIDE], T[STRIDE::STRIDE]
    steady = first * RigidTransform.from_exp_coords(offset / STRIDE * (first.inv() * last).as_exp_coords())
    return (steady.inv() * T[offset::STRIDE]).as_exp_coords()


@pytest.mark.parametrize("shake", [0.0 * SHAKE, SHAKE])
@pytest.mark.parametrize("turn", [0.0, 0.02])
def test_variances_learned_from_key_scans_hold_for_scans_between(turn: float, shake: np.ndarray) -> None:
    """Over three hundred strides; the scans between are not used to learn."""
    T = swinging(300 * STRIDE + 1, turn, shake)
    keys = np.arange(0, len(T), STRIDE)
    unsteadiness = Unsteadiness.of(T[keys], keys.astype(float), np.zeros(len(keys), int))
    for offset in (1, 5, 8):
        squares = (between(T, offset) ** 2).mean(axis=0)
        # a 75th of the prior remains
        prior = 0.0134 * np.repeat([0.1 * max(turn * STRIDE, 0.05), 0.1], 3) ** 2
        variance = unsteadiness.variance(offset, STRIDE - offset)
        assert (squares < 1.6 * variance + 1e-9).all()
        assert (variance < 2.5 * squares + 6 * prior).all()


def test_four_key_scans_leave_the_prior() -> None:
    T = swinging(STRIDE * 4, 0.0, 0 * SHAKE)[::STRIDE]
    unsteadiness = Unsteadiness.of(T, np.arange(4.0), np.zeros(4, int))
    assert (unsteadiness.variance(0.5, 0.5)[3:] > 0).all()
    np.testing.assert_array_equal(unsteadiness.shaken, 0)


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


def test_a_steady_acceleration_at_uneven_times_is_no_shaking() -> None:
    """The speed along one axis changes steadily."""
    times = np.array([0.0, 1.0, 3.0, 3.5, 6.0, 7.0, 9.0, 10.0, 12.0])
    T = RigidTransform.from_components(
        np.column_stack([0.5 * times, 0.01 * times**2, 0 * times]), Rotation.identity(len(times))
    )
    unsteadiness = Unsteadiness.of(T, times, np.zeros(len(times), int))
    np.testing.assert_allclose(unsteadiness.shaken, 0, atol=1e-20)
    assert unsteadiness.curved[4] > unsteadiness.curved[5]


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


def test_two_runs_are_not_compared() -> None:
    """The same course twice, the second time far away and turned around."""
    T, count = swinging(400, 0.02, SHAKE)[::STRIDE], 40
    elsewhere = RigidTransform.from_components([50.0, -20.0, 5.0], Rotation.from_euler("z", 2.5))
    both = RigidTransform.concatenate([T, elsewhere * T])
    times = np.arange(float(count))
    one = Unsteadiness.of(T, times, np.zeros(count, int))
    two = Unsteadiness.of(both, np.concatenate([times, times]), np.repeat([0, 1], count))
    np.testing.assert_allclose(two.shaken, one.shaken * (72 / 76) / (36 / 40), rtol=1e-6, atol=1e-12)
