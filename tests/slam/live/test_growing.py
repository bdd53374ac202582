"""The growing map with a registrar that knows the truth: scans are placed as they arrive."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from threading import Thread
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.live.growing import GrowingMap, Navigate
from sonarmap.slam.live.tracker import LOST
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.surveys import KnowingRegistrar, position_error, random_covariance, ring_poses, scans_of

VOXEL = 0.5
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)
REACH = 6.0  # of `scans_of` [m]
Spoil = Callable[[int, int, Registration], Registration]


class SeeingRegistrar(KnowingRegistrar):
    """Near scans have similar signatures."""

    def signature(self, prepared: Any) -> np.ndarray:
        return self.truth[prepared.index].translation.astype(np.float32)


def far_refused(truth: RigidTransform) -> Spoil:
    """Overlap falls with the distance of two scans; pairs beyond REACH are refused."""

    def spoil(i: int, j: int, given: Registration) -> Registration:
        shared = 1 - float(np.linalg.norm(truth[i].translation - truth[j].translation)) / REACH
        if shared < 0:
            return replace(given, overlap=0.0, accepted=False, probability=0.0, reason="too far")
        return replace(given, overlap=shared)

    return spoil


def growing(truth: RigidTransform, spoil: Spoil | None = None, scale: float = 1.0) -> GrowingMap:
    registrar = SeeingRegistrar(truth, scale * COVARIANCE, spoil or far_refused(truth))
    return GrowingMap(Mapper(registrar, VOXEL))


def decided(grown: GrowingMap) -> None:
    """Decide in another thread, as happens while scans arrive."""
    known = grown.known()
    assert known is not None
    thread = Thread(target=grown.decide, args=(known,))
    grown.idle.set()
    thread.start()
    thread.join()
    assert grown.take_over()
    assert not grown.take_over()


def poses_of(grown: GrowingMap, scans: list[Scan]) -> RigidTransform:
    """Poses of the scans, placed one by one."""
    placed = [grown.add(scan) for scan in scans]
    return RigidTransform.concatenate([grown.pose(each).T_part_sensor for each in placed if each is not None])


def test_every_scan_is_placed_where_it_was_taken() -> None:
    truth = ring_poses(30, turns=0.3)
    scans = scans_of(truth)
    grown = growing(truth, scale=0.01)
    found = poses_of(grown, scans)
    assert len(found) == 30
    assert position_error(found, truth) < 0.1
    assert grown.parts == {0: len(grown.tracker.keys)}
    sigmas = [float(np.trace(pose.covariance[3:, 3:])) for pose in grown.poses]
    assert sigmas[0] == 0.0
    assert sigmas[-1] > 2 * sigmas[2]
    assert len(grown.tracker.keys) < 25  # scans near the last key scan are no key scans


@pytest.mark.slow
def test_loops_move_key_scans_and_the_scans_placed_by_them() -> None:
    truth = ring_poses(80, turns=1.2)
    scans = scans_of(truth)
    grown = growing(truth, scale=6)
    placed = [grown.add(scan) for scan in scans]

    def error() -> float:
        poses = [grown.pose(each).T_part_sensor for each in placed if each is not None]
        return position_error(RigidTransform.concatenate(poses), truth)

    before = error()
    decided(grown)
    assert grown.loops
    assert error() < 0.8 * before
    later = grown.add(replace(scans[-1], stamp=scans[-1].stamp + 1))  # placement continues from there
    assert later is not None
    assert np.linalg.norm(grown.pose(later).T_part_sensor.translation - truth[-1].translation) < before


def test_a_jump_begins_a_part_until_a_known_place_is_seen_again() -> None:
    ring = ring_poses(40, radius=5.0, turns=2.0)  # the second lap follows the first
    away = RigidTransform.from_translation([0.0, 0.0, 40.0])  # out of sight of the ring
    truth = RigidTransform.concatenate([ring[:14], away * ring[14:16], ring[16:]])
    grown = growing(truth)
    scans = scans_of(ring)
    for scan in scans[:14]:
        grown.add(scan)
    assert grown.parts.keys() == {0}
    assert grown.add(scans[14]) is None
    assert grown.add(scans[15]) is not None  # placed by the scan before
    apart = grown.tracker.starts[1]
    assert grown.poses[-1].part == apart
    for scan in scans[16:34]:
        grown.add(scan)
    assert len(grown.parts) == 3  # the return to the first part is not recognized yet
    decided(grown)
    assert grown.poses[-1].part == 0
    assert grown.poses[apart].part == apart  # no loop joins it
    last = grown.poses[-1].T_part_sensor.translation
    assert np.linalg.norm(last - truth[33].translation) < 2.0


def test_a_vehicle_is_lost_after_three_scans_that_cannot_be_placed() -> None:
    truth = ring_poses(30, turns=0.5)
    blind = range(12, 15)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        refused = i in blind or j in blind
        return replace(given, accepted=False, probability=0.0) if refused else far_refused(truth)(i, j, given)

    grown = growing(truth, spoil)
    scans, lost = scans_of(truth), list[bool]()
    for scan in scans:
        grown.add(scan)
        lost.append(grown.tracker.is_lost)
    assert lost.index(True) == blind.start + LOST - 1
    assert not any(lost[blind.stop :])  # the last key scan is still in sight
    assert grown.parts.keys() == {0}


def test_a_restored_map_has_the_same_poses() -> None:
    truth = ring_poses(40, turns=0.7)
    scans = scans_of(truth)
    grown = growing(truth)
    poses_of(grown, scans)
    again = growing(truth)
    for number, scan in enumerate(grown.tracker.keys):
        step = grown.tracker.steps.get(number)
        again.restore(scan, None if step is None else step.registration)
    for one, another in zip(grown.poses, again.poses, strict=True):
        np.testing.assert_allclose(one.T_part_sensor.as_matrix(), another.T_part_sensor.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(one.covariance, another.covariance, atol=1e-12)
    assert again.tracker.starts == grown.tracker.starts


def test_a_part_is_level_if_its_first_scan_has_an_attitude() -> None:
    truth = ring_poses(20, turns=0.4)
    tilted = Rotation.from_euler("ZYX", [0.0, 0.2, -0.1])
    sigmas = np.array([0.01, 0.01, np.inf, np.inf, np.inf, np.inf])
    prior = PosePrior(RigidTransform.from_rotation(tilted), sigmas)
    first, *others = scans_of(truth)
    grown = growing(truth, scale=0.01)
    found = poses_of(grown, [replace(first, prior=prior), *others])
    assert grown.knows_up(0)
    expected = RigidTransform.from_rotation(tilted) * truth
    assert position_error(found, expected) < 0.1


def jumped(navigate: Callable[[RigidTransform], Navigate | None]) -> tuple[GrowingMap, RigidTransform]:
    """A decided map whose vehicle jumped at scan 14, and the true poses of its key scans."""
    ring = ring_poses(40, radius=5.0, turns=1.0)
    away = RigidTransform.from_components([5.0, 0.0, 40.0], Rotation.from_rotvec([0.0, 0.0, 0.5]))
    truth = RigidTransform.concatenate([away * ring[:14], ring[14:]])
    scans = scans_of(ring)
    registrar = SeeingRegistrar(truth, COVARIANCE, far_refused(truth))
    grown = GrowingMap(Mapper(registrar, VOXEL), navigate(truth))
    for scan in scans[:24]:
        grown.add(scan)
    decided(grown)
    return grown, true_poses(truth, grown.tracker.keys)


def true_poses(truth: RigidTransform, scans: Sequence[Scan]) -> RigidTransform:
    return RigidTransform.concatenate([truth[int(scan.name.removeprefix("scan"))] for scan in scans])


def measured(truth: RigidTransform) -> Navigate:
    """Navigation with the true poses as fixes."""
    sigmas = np.array([0.01, 0.01, 0.02, 0.5, 0.5, 0.5])

    def navigate(scans: Sequence[Scan]) -> tuple[Sequence[Scan], None]:
        priors = [PosePrior(T, sigmas) for T in true_poses(truth, scans)]
        return [replace(scan, prior=prior) for scan, prior in zip(scans, priors, strict=True)], None

    return navigate


@pytest.mark.slow
def test_fixes_join_parts_and_place_them_in_the_world() -> None:
    grown, truth = jumped(measured)
    assert grown.parts == {0: len(grown.tracker.keys)}
    assert all(key.prior is not None for key in grown.tracker.keys)
    found = np.array([pose.T_part_sensor.translation for pose in grown.poses])
    assert np.linalg.norm(found - truth.translation, axis=1).max() < 0.3


def test_too_few_key_scans_give_no_decision() -> None:
    truth = ring_poses(4)
    grown = growing(truth)
    for scan in scans_of(truth)[:1]:
        grown.add(scan)
    assert grown.known() is None


class _Watched(list[Any]):
    """A list that calls `then` once, right after it was copied, as if another thread ran."""

    then: Callable[[], object] | None = None

    def __iter__(self) -> Iterator[Any]:
        copy, then, self.then = list[Any](super().__iter__()), self.then, None
        if then is not None:
            then()
        return iter(copy)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("copied", ["keys", "starts"])
def test_a_part_that_begins_during_a_decision_is_a_survey_of_its_own(
    monkeypatch: pytest.MonkeyPatch, copied: str
) -> None:
    truth = ring_poses(30, turns=0.6)
    scans = scans_of(truth)
    grown, surveys = growing(truth), list[Any]()
    for scan in scans[:20]:
        grown.add(scan)

    def begin_part() -> None:
        grown.tracker.anew = True
        grown.add(scans[25])

    watched = _Watched(getattr(grown.tracker, copied))
    watched.then = begin_part
    setattr(grown.tracker, copied, watched)

    def decided(_: Mapper, keys: Sequence[Scan], of: Sequence[int], *__: object) -> None:
        surveys.append([(scan.name, int(survey)) for scan, survey in zip(keys, of, strict=True)])
        raise InterruptedError

    monkeypatch.setattr(Mapper, "decided", decided)
    known = grown.known()
    assert known is not None
    with pytest.raises(InterruptedError):
        grown.decide(known)
    assert len(grown.tracker.starts) == 2
    first = [survey for name, survey in surveys[0] if name != scans[25].name]
    other = [survey for name, survey in surveys[0] if name == scans[25].name]
    assert set(first) == {0}
    assert set(other) <= {1}


def reckoned(truth: RigidTransform) -> Navigate:
    """Navigation with dead reckoning without errors."""

    def navigate(scans: Sequence[Scan]) -> tuple[Sequence[Scan], Odometry]:
        times = np.array([scan.stamp for scan in scans])
        return scans, Odometry(np.arange(len(scans)), true_poses(truth, scans), times)

    return navigate


def test_a_failure_before_the_last_chance_changes_nothing() -> None:
    truth = ring_poses(40, turns=1.0)
    scans = scans_of(truth)
    grown = growing(truth)
    for scan in scans[:5]:
        grown.add(scan)
    keys = list(grown.tracker.keys)
    assert grown.add(scans[25], last_chance=False) is None
    assert grown.tracker.keys == keys
    assert grown.tracker.missed == 0
    assert grown.add(scans[5]) is not None


@pytest.mark.slow
def test_an_unusual_step_must_be_probable() -> None:
    ring = ring_poses(30, turns=0.5)
    turned = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, 1.2]))
    scans = scans_of(ring)
    for probability in (0.9, 0.99):
        truth = RigidTransform.concatenate([ring[:12], ring[12] * turned, ring[13:]])

        def spoil(i: int, j: int, given: Registration, probability: float = probability) -> Registration:
            return replace(given, probability=probability if j == 12 else 1.0)

        grown = growing(truth, spoil)
        placed = [grown.add(scan) for scan in scans[:13]]
        assert (placed[12] is not None) == (probability > 0.95)


@pytest.mark.slow
@pytest.mark.parametrize(("probability", "joins"), [(0.9, False), (0.99, True)])
def test_after_a_scan_that_cannot_be_placed_the_next_step_must_be_probable(probability: float, joins: bool) -> None:
    """It may be a jump to a place that looks the same."""
    truth = ring_poses(30, turns=0.5)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        if j == 12:
            return replace(given, accepted=False, probability=0.0)
        return replace(given, probability=probability if j == 13 else 1.0)

    grown = growing(truth, spoil)
    placed = [grown.add(scan) for scan in scans_of(truth)[:14]]
    assert placed[12] is None
    assert placed[13] is not None  # by the scan before, if not by a key scan
    assert (len(grown.parts) == 1) == joins


@pytest.mark.slow
def test_dead_reckoning_joins_parts() -> None:
    grown, truth = jumped(reckoned)
    assert grown.parts == {0: len(grown.tracker.keys)}
    step = grown.poses[0].T_part_sensor.inv() * grown.poses[-1].T_part_sensor
    off = step.translation - (truth[0].inv() * truth[-1]).translation
    assert np.linalg.norm(off) < 1.5  # 1 percent of 40 m, and the errors of the steps


@pytest.mark.slow
def test_without_navigation_a_jump_leaves_two_parts() -> None:
    assert len(jumped(lambda _: None)[0].parts) == 2
