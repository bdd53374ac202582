"""Trajectory errors: none after a rigid motion, and known errors for known offsets."""

import json
import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.evaluate.trajectory import (
    ARM,
    Alignment,
    align_poses,
    align_positions,
    associate,
    evaluate,
    pair_error,
)

MOVE = RigidTransform.from_components((500.0, -30.0, 7.0), Rotation.from_euler("ZYX", (2.1, -0.4, 0.7)))


def _walk(count: int) -> Trajectory:
    rng = np.random.default_rng(0)
    places = np.cumsum(rng.uniform(-1, 3, (count, 3)), axis=0)
    turns = Rotation.from_rotvec(rng.normal(0, 0.5, (count, 3)))
    return Trajectory(np.arange(count, dtype=np.float64), RigidTransform.from_components(places, turns))


@pytest.mark.parametrize("alignment", ["poses", "positions", "first"])
def test_a_rigidly_moved_trajectory_has_no_error(alignment: Alignment):
    truth = _walk(17)
    moved = Trajectory(truth.stamps, MOVE * truth.T_world_sensor)
    result = evaluate(moved, truth, alignment)
    assert_allclose(result.translation_m, 0, atol=1e-10)
    assert_allclose(result.rotation_deg, 0, atol=1e-5)
    assert_allclose(result.step_translation_m, 0, atol=1e-10)
    assert_allclose(result.step_rotation_deg, 0, atol=1e-5)
    assert_allclose(result.T_truth_estimate.as_matrix(), MOVE.inv().as_matrix(), atol=1e-9)
    assert result.ate_m < 1e-10


def test_one_known_slip_shows_in_one_step_and_in_all_later_poses():
    """From pose 4 on the estimate is 3 degrees and (0, 0.6, 0.8) m off, in the sensor's frame at pose 4."""
    truth = _walk(8)
    slip = RigidTransform.from_components((0.0, 0.6, 0.8), Rotation.from_rotvec((np.deg2rad(3), 0, 0)))
    poses = truth.T_world_sensor
    later = poses[4] * slip * poses[4].inv() * poses[4:]
    estimate = Trajectory(truth.stamps, RigidTransform.concatenate([poses[:4], later]))
    result = evaluate(estimate, truth, "first")
    assert_allclose(result.step_rotation_deg, [0, 0, 0, 3, 0, 0, 0], atol=1e-5)
    assert_allclose(result.step_translation_m[[0, 1, 2, 3, 4, 5, 6]], [0, 0, 0, 1, 0, 0, 0], atol=1e-9)
    assert_allclose(result.translation_m[:5], [0, 0, 0, 0, 1], atol=1e-9)
    assert_allclose(result.rotation_deg, [0, 0, 0, 0, 3, 3, 3, 3], atol=1e-5)


def test_ate_of_opposite_offsets_is_their_length():
    """Corners of a square are 0.3 m up and down in turn, which no rigid motion reduces."""
    square = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]], float)
    off = square + 0.3 * np.array([[0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, -1]])
    turns = Rotation.identity(4)
    stamps = np.arange(4.0)
    truth = Trajectory(stamps, RigidTransform.from_components(square, turns))
    estimate = Trajectory(stamps, MOVE * RigidTransform.from_components(off, turns))
    result = evaluate(estimate, truth)
    assert_allclose(result.translation_m, 0.3, atol=1e-9)
    assert_allclose(result.ate_m, 0.3, atol=1e-9)
    assert_allclose(result.rotation_deg, 0, atol=1e-5)


def test_alignment_finds_a_known_transform_and_never_scales_or_mirrors():
    source = np.random.default_rng(3).normal(0, 5, (40, 3))
    assert_allclose(align_positions(source, MOVE.apply(source)).as_matrix(), MOVE.as_matrix(), atol=1e-10)
    larger = align_positions(source, 3 * source)
    assert_allclose(np.linalg.det(larger.rotation.as_matrix()), 1)
    assert_allclose(larger.rotation.magnitude(), 0, atol=1e-7)
    mirrored = align_positions(source, source * (1, 1, -1))
    assert_allclose(np.linalg.det(mirrored.rotation.as_matrix()), 1)


def test_alignment_by_positions_on_a_line_is_refused():
    stamps = np.arange(5.0)
    line = RigidTransform.from_translation(stamps[:, None] * (1.0, 2.0, -1.0))
    truth = Trajectory(stamps, line)
    with pytest.raises(InputError, match="'first'"):
        evaluate(truth, truth, "positions")
    with pytest.raises(InputError, match="2 common positions"):
        evaluate(_walk(2), _walk(2), "positions")
    assert evaluate(truth, truth, "first").ate_m < 1e-12


@pytest.mark.parametrize("count", [1, 9])
def test_alignment_by_poses_works_on_a_straight_line(count: int):
    """Orientations give the rotation about the line, which positions on it leave open."""
    stamps = np.arange(float(count))
    turns = Rotation.from_rotvec(np.random.default_rng(5).normal(0, 0.2, (count, 3)))
    truth = Trajectory(stamps, RigidTransform.from_components(stamps[:, None] * (10.0, 20.0, -1.0), turns))
    result = evaluate(Trajectory(stamps, MOVE * truth.T_world_sensor), truth)
    assert result.alignment == "poses"
    assert_allclose(result.translation_m, 0, atol=1e-9)
    assert_allclose(result.rotation_deg, 0, atol=1e-5)


def test_alignment_by_poses_minimizes_its_cost():
    """No small further motion lowers the sum of squares in the docstring of `align_poses`."""
    rng = np.random.default_rng(6)
    noise = RigidTransform.from_exp_coords(rng.normal(0, [0.3, 0.1, 0.2, 1.0, 2.0, 0.5], (12, 6)))
    truth = _walk(12).T_world_sensor
    found = MOVE * truth * noise

    def cost(T: RigidTransform) -> float:
        placed = T * found
        chordal = ((truth.rotation.as_matrix() - placed.rotation.as_matrix()) ** 2).sum()
        return float(((truth.translation - placed.translation) ** 2).sum() + ARM**2 / 2 * chordal)

    best = align_poses(found, truth)
    for tangent in 1e-3 * np.vstack([np.eye(6), -np.eye(6)]):
        assert cost(RigidTransform.from_exp_coords(tangent) * best) > cost(best)


def test_stamps_are_associated_as_by_the_table_of_all_differences():
    rng = np.random.default_rng(7)
    for _ in range(20):
        estimate, truth = rng.integers(0, 60, 25) / 8 + 1.7e9, rng.integers(0, 60, 40) / 8 + 1.7e9
        difference = np.abs(estimate[:, None] - truth)
        pairs: dict[int, int] = {}
        for row in np.argsort(difference.ravel(), kind="stable").tolist():
            i, j = divmod(row, len(truth))
            if difference[i, j] <= 0.25 and i not in pairs and j not in pairs.values():
                pairs[i] = j
        mine, true = associate(estimate, truth, 0.25)
        assert dict(zip(mine.tolist(), true.tolist(), strict=True)) == pairs
        assert (np.diff(estimate[mine]) >= 0).all()


@pytest.mark.slow
def test_long_trajectories_are_associated_without_a_table_of_all_differences():
    """An hour of truth at 200 Hz: 1,000 x 720,000 differences would be 5.8 GB."""
    truth = 1.7e9 + np.arange(720_000) / 200
    tracemalloc.start()
    mine, true = associate(truth[360::720] + 1e-3, truth)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200e6
    assert_array_equal(mine, np.arange(1000))
    assert_array_equal(true, np.arange(360, 720_000, 720))


def test_poses_without_a_counterpart_are_counted():
    truth = _walk(10)
    kept = [0, 2, 3, 7, 9]
    part = truth.take(kept)
    estimate = Trajectory(np.concatenate([part.stamps, [99.0]]), part.T_world_sensor[[0, 1, 2, 3, 4, 4]])
    result = evaluate(estimate, truth)
    assert_array_equal(result.stamps, kept)
    assert (result.unmatched_estimates, result.unmatched_truths) == (1, 5)
    assert_allclose(result.translation_m, 0, atol=1e-10)
    assert_allclose(result.step_translation_m, 0, atol=1e-10)


def test_disjoint_stamps_are_refused_with_both_spans():
    truth = _walk(4)
    late = Trajectory(truth.stamps + 1.7e9, truth.T_world_sensor)
    with pytest.raises(InputError, match=r"1700000000\.000000 to 1700000003\.000000 s.*0\.000000 to 3\.000000"):
        evaluate(late, truth)


def test_pair_error_is_the_angle_and_the_distance():
    truth = RigidTransform.from_components((1.0, 2.0, 3.0), Rotation.from_euler("ZYX", (0.4, 0.1, -0.2)))
    turn = Rotation.from_rotvec(np.deg2rad(7.0) * np.array([0.6, 0.0, -0.8]))
    estimate = RigidTransform.from_components((1.3, 2.0, 2.6), truth.rotation * turn)
    error = pair_error(estimate, truth)
    assert_allclose(error.rotation_deg, 7.0, rtol=1e-9)
    assert_allclose(error.translation_m, 0.5, rtol=1e-12)
    assert_allclose(pair_error(truth, estimate).rotation_deg, 7.0, rtol=1e-9)
    assert error.within(7.001, 0.501)
    assert not error.within(6.999, 0.501)
    assert not error.within(7.001, 0.499)


def test_the_result_is_json():
    truth = _walk(6)
    noisy = RigidTransform.from_translation(np.random.default_rng(1).normal(0, 0.1, (6, 3))) * truth.T_world_sensor
    content = json.loads(json.dumps(evaluate(Trajectory(truth.stamps, noisy), truth).to_json(), allow_nan=False))
    assert content["poses"] == 6
    assert content["alignment"] == "poses"
    assert len(content["per_pose"]) == 6
    assert 0 < content["ate_m"]["median"] <= content["ate_m"]["max"]
    assert_allclose(content["ate_m"]["rms"] ** 2, np.mean([row["translation_m"] ** 2 for row in content["per_pose"]]))


def test_a_single_pose_has_no_step():
    result = evaluate(_walk(1), _walk(4), "first")
    assert result.step_translation_m.shape == (0,)
    assert result.unmatched_truths == 3
    assert result.to_json()["rpe_m"] is None
