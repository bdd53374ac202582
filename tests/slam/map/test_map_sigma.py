"""Sigmas of a map's points, by the errors of poses and ranges, compared with simulated errors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map import point_map as point_maps
from sonarmap.slam.map.placed import Beams, PlacedScans, beams_of, pose_variance
from sonarmap.slam.map.point_map import PointMap, fuse
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.room_scans import look, room_poses
from tests.samples.surveys import drawn, random_covariance, random_transforms

VOXEL, SPOTS, HITS, DRAWS = 2.0, 40, 6, 400


def with_noise(placed: PlacedScans, sigma: float) -> PlacedScans:
    """The scans with this range noise [m]."""
    beams = Beams(sigma, 0.01, single=True)
    return replace(placed, beams=(beams,) * len(placed.scans))


def spots(rng: np.random.Generator) -> np.ndarray:
    """(SPOTS, 3) centers of voxels, too far apart for small errors to mix their points [m, world]."""
    places = rng.permutation(20**3)[:SPOTS]
    return 2.0 * np.stack(np.unravel_index(places, (20, 20, 20)), axis=1) - 19


def scans_of_spots(T: RigidTransform, noise: float, rng: np.random.Generator) -> list[Scan]:
    """A scan from every pose, with HITS echoes of each spot and this range noise [m]."""
    world = np.repeat(spots(np.random.default_rng(0)), HITS, axis=0)
    scans = []
    for pose in T:
        points = pose.inv().apply(world)
        ranges = np.linalg.norm(points, axis=1, keepdims=True)
        scans.append(Scan((points * (1 + rng.normal(0, noise, ranges.shape) / ranges)).astype(np.float32)))
    return scans


def scatter(maps: list[PointMap]) -> np.ndarray:
    """(SPOTS,) standard deviation of a map's points over the draws, root mean square of the coordinates [m]."""
    return np.sqrt(np.var([one.points for one in maps], axis=0).mean(axis=1))


def ratios(
    rng: np.random.Generator,
    truth: RigidTransform,
    covariances: np.ndarray,
    noise: float,
    errors: Callable[[], RigidTransform],
) -> np.ndarray:
    """(SPOTS,) scatter over the draws of these errors, divided by sigmas of the first map."""
    maps = []
    for _ in range(DRAWS):
        T = errors()
        scans = scans_of_spots(truth, noise, rng)
        maps.append(fuse(with_noise(PlacedScans.of(scans, T, VOXEL, covariances=covariances), max(noise, 1e-6))))
    return scatter(maps) / maps[0].sigma


def test_the_scan_with_the_smaller_covariance_counts_more() -> None:
    scans = [Scan(np.array([[5.5, 0.4 + 0.2 * k, 0.5]], np.float32)) for k in range(2)]
    sure, vague = (np.diag(np.repeat([1e-9, sigma], 3) ** 2) for sigma in (0.1, 0.3))
    placed = PlacedScans.of(scans, RigidTransform.identity(2), VOXEL, covariances=np.stack([sure, vague]))
    fused = fuse(with_noise(placed, 1e-6))
    np.testing.assert_allclose(fused.points, [[5.5, 0.42, 0.5]], atol=1e-6)
    np.testing.assert_allclose(fused.sigma, 0.9 * 0.1 + 0.1 * 0.3, rtol=1e-4)


def test_the_order_of_the_scans_and_the_grouping_do_not_matter(monkeypatch) -> None:
    monkeypatch.setattr(point_maps, "MERGE_ROWS", 1)
    rng = np.random.default_rng(8)
    truth = room_poses(5)
    scans = [look(pose, rng, sigma=0.05, wild=0.02) for pose in truth]
    covariances = np.stack([random_covariance(rng, 0.002, 0.02) for _ in range(5)])
    surveys, order = [7, 7, 3, 3, 3], [3, 0, 4, 2, 1]
    first = fuse(PlacedScans.of(scans, truth, 0.5, covariances=covariances, surveys=surveys))
    numbers = {"covariances": covariances[order], "surveys": [surveys[k] for k in order]}
    other = fuse(PlacedScans.of([scans[k] for k in order], truth[order], 0.5, order, **numbers))
    np.testing.assert_allclose(other.points, first.points, atol=1e-9)
    np.testing.assert_allclose(other.sigma, first.sigma, rtol=1e-6)
    for name in ("scan", "seen", "count", "survey"):
        np.testing.assert_array_equal(getattr(other, name), getattr(first, name))
    np.testing.assert_array_equal(first.survey, np.array(surveys)[first.scan])


def test_moving_the_world_moves_the_map() -> None:
    rng = np.random.default_rng(9)
    truth = room_poses(3)
    scans = [look(pose, rng) for pose in truth]
    covariances = np.stack([random_covariance(rng, 0.002, 0.02) for _ in range(3)])
    # a quarter turn and whole voxels keep the lattice
    motion = RigidTransform.from_matrix([[0, -1, 0, 20.0], [1, 0, 0, -12.0], [0, 0, 1, 3.0], [0, 0, 0, 1]])
    here = fuse(PlacedScans.of(scans, truth, 0.5, covariances=covariances))
    there = fuse(PlacedScans.of(scans, motion * truth, 0.5, covariances=covariances))
    moved = motion.apply(here.points)
    order = [np.lexsort(np.round(points, 4).T) for points in (moved, there.points)]
    np.testing.assert_allclose(there.points[order[1]], moved[order[0]], atol=1e-6)
    np.testing.assert_allclose(there.sigma[order[1]], here.sigma[order[0]], rtol=1e-4)


def test_range_noise_is_estimated_from_a_scan() -> None:
    pose, sigma = room_poses(3)[1], 0.15
    scans = [look(pose, np.random.default_rng(seed), sigma, wild=0.02) for seed in range(6)]
    found = [beams_of(scan.points, 0.25) for scan in scans]
    assert all(beams.single for beams in found)
    sigmas = [beams.sigma for beams in found]
    np.testing.assert_allclose(np.median(sigmas), sigma, rtol=0.15)  # wild echoes widen it by a tenth
    np.testing.assert_allclose(sigmas, sigma, rtol=0.3)
    spacing = [np.degrees(beams.spacing) for beams in found]
    np.testing.assert_allclose(spacing, 0.9, atol=0.15)  # beams every 0.92 and 0.90 degrees


def test_refuses_surveys_of_another_length() -> None:
    placed = PlacedScans.of([Scan(np.ones((1, 3), np.float32))], RigidTransform.identity(1), 1.0)
    with pytest.raises(InputError, match=r"1 scans and .* surveys"):
        replace(placed, surveys=(1, 2))


def test_a_scan_of_few_points_is_no_single_view() -> None:
    found = beams_of(np.array([[1.0, 2, 3], [0, 0, 0]]), VOXEL)
    assert not found.single
    assert found.sigma == VOXEL / np.sqrt(12)


def test_pose_variance_is_a_third_of_the_trace() -> None:
    rng = np.random.default_rng(7)
    covariance, points = random_covariance(rng, 0.3, 0.5), rng.normal(size=(20, 3)) * [5, 2, 1]
    for point, found in zip(points, pose_variance(points, covariance), strict=True):
        x, y, z = point
        jacobian = np.hstack([-np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.eye(3)])
        np.testing.assert_allclose(found, np.trace(jacobian @ covariance @ jacobian.T) / 3, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "together"), [(1, True), (3, True), (3, False)])
def test_sigmas_match_the_scatter_and_only_independent_errors_average_out(count: int, together: bool) -> None:
    """Four hundred draws of three coordinates estimate a spot's scatter to 3 %."""
    rng = np.random.default_rng(6)
    truth = random_transforms(rng, count, length=2.0)
    covariances = np.stack([random_covariance(rng, 0.002, 0.02) for _ in range(count)])
    if together and count > 1:
        covariances = np.tile(np.diag(np.repeat([1e-12, 0.0016], 3)), (count, 1, 1))

    def errors() -> RigidTransform:
        if together and count > 1:
            return RigidTransform.from_translation(rng.normal(0, 0.04, 3)) * truth
        return truth * RigidTransform.concatenate([drawn(rng, covariance) for covariance in covariances])

    ratio = ratios(rng, truth, covariances, 0.05, errors)
    assert (ratio < (1.12 if together else 1.05)).all()
    assert (ratio > (0.88 if together else 0.9 / np.sqrt(count))).all()
