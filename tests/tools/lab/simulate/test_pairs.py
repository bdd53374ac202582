"""Random pairs: truth, overlap and rotations of overlapping pairs, and unrelated pairs."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate import viewpoints
from sonarmap.tools.lab.simulate.random_pairs import (
    SET_OVERLAPS,
    SET_SCENES,
    SET_SIGMA2,
    Turn,
    draw_turn,
    evaluation_pair,
    evaluation_unrelated,
    random_pair,
)
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, Sensor, bare
from sonarmap.tools.lab.simulate.viewpoints import mutual_overlap
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import QUIET

STEEP = float(np.deg2rad(35.0))


def _small(scene: str) -> Sensor:
    return replace(bare(SENSORS[SCENE_KINDS[scene].sensor]), columns=128, rows=64)


def _distances(target: Scan, source: Scan, T_target_source: RigidTransform) -> np.ndarray:
    """Distances [m] of the source's points to their nearest in the target."""
    return KDTree(target.points).query(T_target_source.apply(source.points))[0]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(("scene", "overlaps"), list(zip(SET_SCENES, SET_OVERLAPS * 2, strict=False)))
@pytest.mark.parametrize("turn", ["view", "yaw", "any"])
def test_a_turned_pair_fits_its_truth_and_the_wanted_overlap(scene: str, overlaps: tuple[float, float], turn: Turn):
    target, source, truth = random_pair(11, overlaps, QUIET, scene, _small(scene), turn, STEEP)
    radius = 2.0 * SCENE_KINDS[scene].scale
    assert overlaps[0] <= mutual_overlap(target.points, source.points, truth, radius) <= overlaps[1]
    common = (near := _distances(target, source, truth)) < radius
    # after a further small rotation about the source, the common points no longer lie on the target
    for axis in np.deg2rad(4.0) * np.eye(3):
        off = truth * RigidTransform.from_rotation(Rotation.from_rotvec(axis))
        assert np.mean(_distances(target, source, off)[common]) > 1.15 * np.mean(near[common])


def test_a_frame_turned_by_yaw_keeps_the_drawn_tilt_and_turns_about_z():
    """Angles are compared one by one, without the class's own composition."""
    for seed in range(20):
        frame = draw_turn("yaw", STEEP, np.random.default_rng(seed))
        for aside, share in ((0.4, 0.0), (-1.1, 0.5), (0.7, 1.0)):
            sensor = frame.R_target_sensor(aside, share)
            yaw, pitch, roll = frame.R_target_frame(sensor).as_euler("ZYX")
            assert_allclose((pitch, roll), (frame.pitch, frame.roll), atol=1e-12)
            assert_allclose(np.angle(np.exp(1j * (yaw - aside - frame.about_z))), 0.0, atol=1e-12)
        # at a share of 1 the sensor has the whole tilt: its z is the frame's
        about_z = sensor.inv() * frame.R_target_frame(sensor)
        assert_allclose(about_z.apply((0, 0, 1)), (0, 0, 1), atol=1e-12)
        # at a share of 0 it has none: its z is the target's
        assert_allclose(frame.R_target_sensor(0.3, 0.0).apply((0, 0, 1)), (0, 0, 1), atol=1e-12)


def test_a_turned_frame_does_not_change_ranges_and_noise():
    """Beams measure the same; only the frame of the source's points differs."""
    noise = Noise(sigma2=0.3, outliers=0.03, dropouts=0.2, ghosts=0.02, speckle=1.0)
    pairs = [random_pair(4, (0.4, 0.6), noise, "clutter", _small("clutter"), turn, STEEP) for turn in ("yaw", "any")]
    (target, source, truth), (other_target, other_source, other) = pairs
    assert_array_equal(target.points, other_target.points)
    assert_array_equal(source.strength, other_source.strength)
    ranges = [np.linalg.norm(scan.points, axis=1) for scan in (source, other_source)]
    assert_allclose(*ranges, rtol=1e-5)
    assert_allclose(truth.translation, other.translation, atol=1e-9)
    assert_allclose(truth.apply(source.points), other.apply(other_source.points), atol=1e-4)
    assert (truth.rotation.inv() * other.rotation).magnitude() > 0.1


def test_the_quick_check_refuses_no_pose_that_all_beams_accept(monkeypatch: pytest.MonkeyPatch):
    quick = random_pair(6, (0.7, 0.9), QUIET, "harbor", _small("harbor"), "yaw")
    monkeypatch.setattr(viewpoints, "DOUBT", 1.0)
    slow = random_pair(6, (0.7, 0.9), QUIET, "harbor", _small("harbor"), "yaw")
    assert_array_equal(quick[1].points, slow[1].points)
    assert_array_equal(quick[2].as_matrix(), slow[2].as_matrix())


def test_a_set_covers_all_combinations_reproducibly():
    count = 15 * len(SET_SCENES)
    pairs = [evaluation_pair(number, 7, "yaw") for number in range(count)]
    share = {name: SCENE_KINDS[name].scale ** 2 for name in SET_SCENES}
    met = {(pair.scene, pair.overlaps, round(pair.noise.sigma2 / share[pair.scene], 6)) for pair in pairs}
    assert met == set(product(SET_SCENES, SET_OVERLAPS, SET_SIGMA2))
    assert len({pair.seed for pair in pairs}) == count
    assert pairs[13] == evaluation_pair(13, 7, "yaw")
    assert pairs[13].seed != evaluation_pair(13, 8, "yaw").seed
    assert evaluation_unrelated(13, 7) == evaluation_unrelated(13, 7)
    assert evaluation_unrelated(13, 7).seed != pairs[13].seed
    for bad in ((-1, 0), (0, -1)):
        refuses(">= 0", evaluation_pair, *bad, "yaw")
