"""Scores of pairs, maps and poses against the truth: known errors, and errors drawn from the covariances."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.names import TriedPair
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.lab.evaluate.map_error import map_error, read_points, reference_of
from sonarmap.tools.lab.evaluate.pose_calibration import PoseCalibration, calibrate_poses
from sonarmap.tools.lab.evaluate.survey import PairScore, score_pairs
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.scenes.simulated import COARSE, QUIET

LOOP_VOXEL = 0.7
TRUE_PAIRS = {
    0: RigidTransform.from_components((3.0, -1.0, 0.5), Rotation.from_euler("ZYX", (0.4, 0.1, -0.2))),
    2: RigidTransform.from_components((-4.0, 6.0, 1.5), Rotation.from_euler("ZYX", (2.1, -0.3, 0.2))),
    5: RigidTransform.from_components((9.0, 2.0, -0.5), Rotation.from_euler("ZYX", (-1.1, 0.2, 0.3))),
}


def tried(i: int, j: int, kept: bool, turn_deg: float = 0.0, shift_voxels: float = 0.0) -> TriedPair:
    """A pair whose measurement is off by `turn_deg` and `shift_voxels`."""
    off = RigidTransform.from_components(
        (0, shift_voxels * LOOP_VOXEL, 0), Rotation.from_rotvec((0, np.deg2rad(turn_deg), 0))
    )
    return TriedPair(i, j, "loop", kept, TRUE_PAIRS[i].inv() * TRUE_PAIRS[j] * off)


def test_a_right_pair_is_within_both_bounds() -> None:
    pairs = [
        tried(0, 2, True, RIGHT_DEG - 0.01, RIGHT_VOXELS - 0.01),
        tried(0, 2, True, RIGHT_DEG + 0.01),
        tried(2, 5, True, 0.0, RIGHT_VOXELS + 0.01),
        tried(5, 0, False, 1.0, 1.0),
        tried(5, 2, False, 90.0),
        tried(0, 5, False, 0.0, 40.0),
        tried(2, 0, False, 0.0, 4.0),
    ]
    score = score_pairs(pairs, TRUE_PAIRS, LOOP_VOXEL)
    assert score == PairScore(kept_right=1, kept_wrong=2, rejected_right=1, rejected_wrong=3)
    assert (score.precision, score.recall) == (1 / 3, 1 / 2)
    assert (score.rejected_precision, score.rejected_recall) == (3 / 4, 3 / 5)


@pytest.mark.parametrize("pairs", [[], [TriedPair(0, 2, "loop", False, None)]])
def test_shares_without_pairs_are_none(pairs: list[TriedPair]) -> None:
    score = score_pairs(pairs, TRUE_PAIRS, LOOP_VOXEL).to_json()
    assert [score[name] for name in ("precision", "recall", "rejected_precision", "rejected_recall")] == [None] * 4


GRID = np.stack(np.meshgrid(np.arange(20.0), np.arange(10.0), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)


def test_the_map_error_of_known_offsets(tmp_path: Path) -> None:
    """Of 200 points 120 lie 0.1 m above the reference's, 60 lie 0.3 m and 20 lie 2 m above."""
    write_ply(tmp_path / "truth.ply", GRID)
    off = np.repeat([0.1, 0.3, 2.0], [120, 60, 20])
    result = map_error(
        GRID + off[:, None] * np.array([0, 0, 1]), reference_of(tmp_path / "truth.ply"), voxel=0.3 + 1e-9
    )
    assert result.nearest == "point"
    assert_allclose(result.distance_m, off, atol=1e-9)
    assert_allclose([result.median_m, result.within_voxel], [0.1, 0.9], atol=1e-9)
    assert_allclose(map_error(GRID, reference_of(tmp_path / "truth.ply"), 0.3).p90_m, 0.0, atol=1e-12)


def test_simulated_points_lie_on_the_true_surface(tmp_path: Path) -> None:
    simulation = simulate(SimulationSettings(trajectory="lawnmower", count=2, sensor=COARSE, noise=QUIET, seed=21))
    write_simulation(simulation, tmp_path)
    points = simulation.truth.T_world_sensor[1].apply(simulation.scans[1].points.astype(float))
    for path in (tmp_path, tmp_path / "description.json"):
        reference = reference_of(path)
        assert (reference.nearest, reference.name) == ("surface", "the true surface of floodgate, seed 21")
        assert map_error(points, reference, 1.0).p90_m < 1e-4
    lifted = map_error(points + np.array([0, 0, 300.0]), reference_of(tmp_path), 1.0)
    assert lifted.median_m > 200
    assert lifted.within_voxel == 0.0


def test_points_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", np.array([[1.0, 2, 3], [np.nan, 0, 0]]))
    assert read_points(tmp_path / "a.ply").tolist() == [[1, 2, 3]]
    write_ply(tmp_path / "b.ply", np.full((2, 3), np.nan))
    with pytest.raises(InputError, match="none of its points is finite"):
        read_points(tmp_path / "b.ply")


def test_an_invalid_reference_is_refused(tmp_path: Path) -> None:
    for name in ("truth.tum", "missing.json", "missing.ply", "nothing"):
        with pytest.raises(InputError, match=name):
            reference_of(tmp_path / name)


COUNT = 4000
MOVE = RigidTransform.from_components((40.0, -7.0, 2.0), Rotation.from_euler("ZYX", (1.2, -0.3, 0.4)))


def drawn(scale: float = 1.0, anchor: float = 1e-6) -> tuple[RigidTransform, RigidTransform, np.ndarray]:
    """Poses, their truth and covariances; the errors have `scale` times the stated standard deviations."""
    rng = np.random.default_rng(17)
    truth = RigidTransform.from_components(rng.uniform(-30, 30, (COUNT, 3)), Rotation.random(COUNT, rng=rng))
    roots = rng.normal(size=(COUNT, 6, 6)) * np.array([0.01, 0.02, 0.03, 0.3, 0.2, 0.1])[:, None]
    roots[0] = anchor * np.eye(6)
    xi = scale * np.einsum("nij,nj->ni", roots, rng.standard_normal((COUNT, 6)))
    return truth * RigidTransform.from_exp_coords(-xi), truth, roots @ np.swapaxes(roots, 1, 2)


def calibrated(*arguments) -> PoseCalibration:
    result = calibrate_poses(*arguments)
    assert result is not None
    return result


def test_consistent_poses_are_in_their_95_percent_ellipsoids() -> None:
    """Of 4000 independent poses: 0.95 within 0.015 (4 sigma), means within 5 sigma of 6 and of 3."""
    found, truth, covariances = drawn()
    result = calibrated(MOVE * found, truth, covariances)
    assert (result.anchor, len(result.nees)) == ("first", COUNT - 1)
    assert_allclose([result.within_95, result.position_within_95], 0.95, atol=0.015)
    assert_allclose(result.nees.mean(), 6, atol=5 * np.sqrt(12 / COUNT))
    assert_allclose(result.position_nees.mean(), 3, atol=5 * np.sqrt(6 / COUNT))


def test_different_origins_are_detected() -> None:
    found, truth, covariances = drawn(anchor=0.05)
    moved = calibrated(RigidTransform.from_translation([0.0, -400.0, 7.0]) * found, truth, covariances)
    assert moved.origins_differ
    assert_allclose(moved.offset, [0.0, 400.0, -7.0], atol=0.1)
    assert moved.to_json()["origins_differ"]
    assert not calibrated(found, truth, covariances).origins_differ
    assert not calibrated(MOVE * found, truth, covariances).origins_differ  # turned, too
    assert not calibrated(*drawn()).origins_differ


def test_the_nees_of_a_known_error() -> None:
    """0.2 rad about y at sigma 0.1, and 0.6 m along the body's z at sigma 0.3: 4 + 4."""
    truth = RigidTransform.concatenate([RigidTransform.identity(), MOVE])
    off = RigidTransform.from_exp_coords([[0, 0.2, 0, 0, 0, 0.6]])
    found = RigidTransform.concatenate([RigidTransform.identity(), (MOVE * off.inv())[0]])
    sigmas = np.diag([0.5, 0.1, 0.5, 0.7, 0.7, 0.3]) ** 2
    result = calibrated(found, truth, np.stack([1e-12 * np.eye(6), sigmas]))
    assert_allclose([result.nees[0], result.position_nees[0]], [8, 4], rtol=1e-9)


@pytest.mark.parametrize(
    ("unmeasured", "motion"),
    [
        (("heading", "east", "north"), (0.0, 0.0, 1.3, 40.0, -9.0, 0.0)),
        (("heading",), (0.0, 0.0, -0.7, 0.0, 0.0, 0.0)),
        (("tilt_x", "tilt_y", "up"), (0.4, -0.2, 0.3, 0.0, 0.0, 5.0)),
        ((), (0.0,) * 6),
    ],
)
def test_unmeasured_directions_are_aligned_at_the_first_pose(unmeasured, motion):
    """The estimate is the truth moved about its first pose in the unmeasured directions alone."""
    truth = drawn()[1]
    covariances = np.broadcast_to(np.diag([0.01**2] * 3 + [0.1**2] * 3), (len(truth), 6, 6))
    place = RigidTransform.from_translation(truth[0].translation)
    turn = RigidTransform.from_rotation(Rotation.from_rotvec(motion[:3]))
    found = RigidTransform.from_translation(motion[3:]) * place * turn * place.inv() * truth
    result = calibrated(found, truth, covariances, unmeasured)
    assert result.anchor == ("partly" if unmeasured else "world")
    np.testing.assert_allclose(result.nees, 0, atol=1e-12)
    if unmeasured:
        assert calibrated(found, truth, covariances).nees.max() > 100
    raised = RigidTransform.from_translation([0.0, 0.0, 1.0]) * truth
    assert calibrated(raised, truth, covariances, ("heading", "east", "north")).nees.min() > 50


def test_a_single_pose_has_no_calibration() -> None:
    found, truth, covariances = drawn()
    assert calibrate_poses(found[:1], truth[:1], covariances[:1]) is None
