"""Covariances and overlaps of the baselines."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.baselines.points import covariance, overlap, thin

VOXEL = 0.5
# p_target = T p_source: a quarter turn and more, so that the axes of both sides differ
T_TRUE = RigidTransform.from_components([6.0, -2.0, 1.0], Rotation.from_euler("ZYX", [80, 10, -5], degrees=True))


def sheet(rng: np.random.Generator, corner: list[float], first: list[float], second: list[float]) -> np.ndarray:
    """Points (n, 3) at random on a parallelogram [m], 40 to the square meter."""
    a, b = np.array(first), np.array(second)
    count = int(40 * np.linalg.norm(np.cross(a, b)))
    return np.array(corner) + rng.uniform(size=(count, 1)) * a + rng.uniform(size=(count, 1)) * b


def room(seed: int) -> np.ndarray:
    """Points [m, target's frame] on a floor, a wall along x and one across it, with noise."""
    rng = np.random.default_rng(seed)
    floor = sheet(rng, [2, -4, -2], [16, 0, 0], [0, 8, 0])
    wall = sheet(rng, [2, 4, -2], [16, 0, 0], [0, 0, 5])
    across = sheet(rng, [18, -4, -2], [0, 8, 0], [0, 0, 5])
    points = np.vstack([floor, wall, across])
    return points + 0.05 * rng.normal(size=points.shape)


def clouds(seed: int):
    target = Scan(room(seed).astype(np.float32))
    source = Scan(T_TRUE.inv().apply(room(1000 + seed)).astype(np.float32))
    return thin(target, VOXEL), thin(source, VOXEL)


def test_the_information_equals_the_numerical_hessian() -> None:
    """The information is the curvature of the squared distances under steps T Exp(xi), up to a scale."""
    target, source = clouds(5)
    moved = T_TRUE.apply(source.points)
    _, nearest = target.tree.query(moved)
    near = np.linalg.norm(moved - target.points[nearest], axis=1) <= 2 * VOXEL

    def off(xi: np.ndarray) -> np.ndarray:
        stepped = (T_TRUE * RigidTransform.from_exp_coords(xi)).apply(source.points[near])
        return np.sum(target.normals[nearest[near]] * (stepped - target.points[nearest[near]]), axis=1)

    step = 1e-5
    J = np.stack([(off(step * axis) - off(-step * axis)) / (2 * step) for axis in np.eye(6)], axis=1)
    scaled = np.linalg.inv(covariance(target, source, T_TRUE, VOXEL))
    wanted = J.T @ J
    np.testing.assert_allclose(scaled / scaled[5, 5], wanted / wanted[5, 5], rtol=1e-2, atol=2e-3)


def test_overlap_is_the_smaller_share_of_both_clouds() -> None:
    rng = np.random.default_rng(6)
    whole = sheet(rng, [5, -8, -3], [0, 16, 0], [0, 0, 6])
    target, source = (
        thin(Scan(whole.astype(np.float32)), VOXEL),
        thin(Scan(whole[whole[:, 1] < -4].astype(np.float32)), VOXEL),
    )
    for pair in ((target, source), (source, target)):
        share = overlap(*pair, RigidTransform.identity(), 2 * VOXEL)
        assert 0.25 < share < 0.25 + 1.5 * 2 * VOXEL / 16
    assert overlap(target, source, RigidTransform.from_translation([50.0, 0, 0]), 2 * VOXEL) == 0
