"""Point-to-plane steps on the device equal NumPy's, singly and in sequence."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.refinement import TERM, Noise, Refinement, Weighting
from tests.kernels.surface.scenes import bent_sheet, random_rows, upload
from tests.kernels.surface.steps import Pose, moved, squared_doubts, sums_of

WEIGHTING = Weighting(bell=1 / 6, wide_bell=0.8, bells=4.0, measured=3.0, scale=1.5)
NOISE = Noise(scale=175.0, power=2.25, narrowest=0.02, stretched=2.5e-4, usual=0.1)


def leaning_rows(points: np.ndarray, seed: int) -> np.ndarray:
    """Elements with rays from above, whose normals deviate by about 0.1 from those of the sheet."""
    rows = random_rows(points, seed)
    normals = np.column_stack([-0.2 * np.cos(points[:, 0] / 11), -0.1 * points[:, 1] / 17, np.ones(len(points))])
    normals[np.abs(points[:, 2]) > 4] = [1, 0, 0.1]
    normals += 0.1 * np.random.default_rng(seed).normal(size=normals.shape)
    rows[:, 4:7] = normals / np.linalg.norm(normals, axis=1, keepdims=True) * (1 - 2 * (rows[:, :1] > 5))
    rows[:, 8:11] = points - [3.0, -2.0, 25.0]
    return rows


def begin(poses: int, seed: int, stretches: bool) -> list[Pose]:
    rng = np.random.default_rng(seed)
    stretch = np.array([0.01, -0.004]) if stretches else np.zeros(2)
    turns = Rotation.from_rotvec(rng.normal(0, 0.03, (poses, 3))).as_matrix()
    return [
        Pose(turn, shift, width, stretch)
        for turn, shift, width in zip(turns, rng.normal(0, 0.5, (poses, 3)), rng.uniform(0, 0.5, poses), strict=True)
    ]


def measured(poses: int, count: int, off: float) -> np.ndarray:
    """Random measurements of `count` components that are `off` standard deviations away."""
    rng, terms = np.random.default_rng(count), np.zeros(poses, TERM)
    terms["off"][:, :count] = off * rng.choice([-1.0, 1.0], (poses, count)) / np.sqrt(count)
    terms["jacobian"][:, :count] = rng.normal(size=(poses, count, 6)) * [50, 50, 50, 3, 3, 3]
    terms["shortest"][:, :, :count] = np.linalg.pinv(terms["jacobian"][:, :count])
    root = 0.001 * rng.normal(size=(poses, 6, 6)) * np.repeat([0.1, 1.0], 3)[:, None] + 1e-3 * np.eye(6)
    terms["systematic"], terms["limits"] = root @ root.mT, (9.0 + count, 16.0 + count)
    return terms


def refinement(
    device: Device,
    rows: list[np.ndarray],
    most: int,
    poses: list[Pose],
    stretches: bool,
    terms: np.ndarray | None = None,
) -> Refinement:
    target, source = (upload(device, each) for each in rows)
    steps = Refinement(device, target, source, most, WEIGHTING, NOISE, stretches)
    turn, shift, width, stretch = (
        np.stack([getattr(pose, name) for pose in poses]) for name in ("turn", "shift", "width", "stretch")
    )
    steps.begin(turn, shift, width, stretch, terms)
    return steps


@pytest.fixture(scope="module")
def rows() -> list[np.ndarray]:
    return [leaning_rows(bent_sheet(count, seed), seed) for seed, count in ((1, 2500), (2, 1800))]


@pytest.mark.parametrize("stretches", [False, True])
@pytest.mark.parametrize(("reach", "most", "poses"), [(8.0, 100, 24), (3.0, 333, 3), (1.5, 5000, 2)])
def test_sums_equal_the_twin(device, rows, reach, most, poses, stretches):
    start = begin(poses, most, stretches)
    steps = refinement(device, rows, most, start, stretches)
    steps.step(reach, moves=False)
    got = steps.end()[1].read()
    for n, pose in enumerate(start):
        want = sums_of(rows, most, pose, reach, WEIGHTING, stretches)
        for name in ("moving", "whole", "shared", "gradient", "total", "squares"):
            value = getattr(want, name)
            np.testing.assert_allclose(got[name][n], value, atol=3e-5 * np.abs(value).max())
        assert got["width"][n] == pytest.approx(pose.width, abs=2e-5)
        np.testing.assert_allclose(got["turn"][n], pose.turn, atol=1e-12)
        doubts, share = squared_doubts(want)
        apart = np.minimum(np.diff(share, prepend=-np.inf), np.diff(share, append=np.inf)) > 1e-3
        np.testing.assert_allclose(got["doubts"][n, :6][apart], doubts[apart], rtol=1e-3)


@pytest.mark.parametrize("stretches", [False, True])
def test_steps_equal_the_twin(device, rows, stretches):
    poses = begin(3, 4, stretches)
    steps = refinement(device, rows, 600, poses, stretches)
    for reach in (4.0, 3.0, 2.0):
        steps.step(reach)
        for n, pose in enumerate(poses):
            poses[n] = moved(pose, sums_of(rows, 600, pose, reach, WEIGHTING, stretches), NOISE, stretches)
    steps.step(2.0, moves=False)
    ended, records = steps.end()
    leads, got = ended.get()[:, :12].reshape(-1, 3, 4), records.read()
    for n, pose in enumerate(poses):
        np.testing.assert_allclose(got["turn"][n], pose.turn, atol=3e-5)
        np.testing.assert_allclose(got["shift"][n], pose.shift, atol=1e-3)
        np.testing.assert_allclose(got["stretch"][n], pose.stretch, atol=3e-5)
        assert got["width"][n] == pytest.approx(pose.width, abs=1e-4)
        np.testing.assert_allclose(got["turn"][n] @ got["turn"][n].T, np.eye(3), atol=1e-12)
        following = moved(pose, sums_of(rows, 600, pose, 2.0, WEIGHTING, stretches), NOISE, stretches)
        np.testing.assert_allclose(got["next_turn"][n], following.turn, atol=5e-5)
        np.testing.assert_allclose(got["next_shift"][n], following.shift, atol=2e-3)
        np.testing.assert_allclose(got["next_stretch"][n], following.stretch, atol=5e-5)
        np.testing.assert_allclose(leads[n, :, :3], got["next_turn"][n], atol=1e-7)
        np.testing.assert_allclose(leads[n, :, 3], got["next_shift"][n], atol=1e-6)


@pytest.mark.parametrize("stretches", [False, True])
@pytest.mark.parametrize(("count", "off"), [(1, 0.5), (3, 4.0), (6, 2.0), (6, 9.0)])
def test_steps_with_instruments_equal_the_twin(device, rows, stretches, count, off):
    """Residuals that agree with the scans, that contradict them somewhat, and so much that only instruments count."""
    poses, terms = begin(3, 4, stretches), measured(3, count, off)
    steps = refinement(device, rows, 600, poses, stretches, terms)
    for n, pose in enumerate(poses):
        pose.off = terms["off"][n]
    for reach in (3.0, 2.0):
        steps.step(reach)
        for n, pose in enumerate(poses):
            poses[n] = moved(pose, sums_of(rows, 600, pose, reach, WEIGHTING, stretches), NOISE, stretches, terms[n])
    steps.step(2.0, moves=False)
    got = steps.end()[1].read()
    for n, pose in enumerate(poses):
        sums = sums_of(rows, 600, pose, 2.0, WEIGHTING, stretches)
        following = moved(pose, sums, NOISE, stretches, terms[n])
        alone = moved(pose, sums, NOISE, stretches)
        np.testing.assert_allclose(got["off"][n], pose.off, atol=2e-2)
        np.testing.assert_allclose(got["alone"][n][3:], alone.shift - pose.shift, atol=2e-3)
        np.testing.assert_allclose(got["next_turn"][n], following.turn, atol=5e-5)
        np.testing.assert_allclose(got["next_shift"][n], following.shift, atol=2e-3)
        np.testing.assert_allclose(got["next_stretch"][n], following.stretch, atol=5e-5)


def test_width_of_an_even_number_of_gaps_is_the_mean_of_the_middle_ones(device: Device) -> None:
    """Distances from a plane of 0.1, 0.2, 0.4 and 0.7, from target to source and back."""
    ours, theirs = np.zeros((2, 4, 12), np.float32)
    ours[:, 0] = theirs[:, 0] = [0, 9, 18, 27]
    theirs[:, 2] = [0.1, -0.2, 0.4, 0.7]
    ours[:, 6] = theirs[:, 6] = 1
    steps = Refinement(device, upload(device, ours), upload(device, theirs), 10, WEIGHTING, NOISE)
    steps.begin(np.eye(3)[None], np.zeros((1, 3)), np.zeros(1))
    steps.step(3.0, moves=False)
    assert steps.end()[1].read()["width"][0] == pytest.approx(0.3, abs=1e-6)


def test_pose_is_unchanged_if_nothing_is_within_reach(device: Device, rows: list[np.ndarray]) -> None:
    pose = Pose(np.eye(3), np.array([900.0, 0, 5]), 0.2, np.zeros(2))
    steps = refinement(device, rows, 1000, [pose], True)
    for reach in (8.0, 2.0):
        steps.step(reach)
    steps.step(2.0, moves=False)
    got = steps.end()[1].read()
    assert got["total"][0] == got["squares"][0] == 0
    assert not got["whole"].any()
    np.testing.assert_array_equal(got["shift"][0], pose.shift)
    assert got["width"][0] == pytest.approx(0.2)
    assert np.isfinite(got["doubts"]).all()
