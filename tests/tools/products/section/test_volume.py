"""Volumes of a block and a slope by hand, their sigmas by drawing errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.products.section import Volume, volume_between, volume_to_level
from tests.tools.products.section.made_up import bed, moved, placed

HERE = Georeference(60.0, 9.0, height=1.0)


def volumes(volume: Volume) -> list[float]:
    return [volume.cut[0], volume.fill[0], volume.net[0]]


def test_volumes_of_a_block_on_a_bed() -> None:
    """A bed of 10 m by 8 m at -10 m with a block of 3 m by 2 m that is 2 m high."""
    points = bed()
    block = (points[:, 0] < 3) & (points[:, 1] < 2)
    points[block, 2] = -8
    volume = volume_to_level(placed(points), -9.0, 1.0)
    assert volumes(volume) == pytest.approx([6, 74, 68])
    assert (volume.compared, volume.map_only, volume.target_only) == (80, 0, 0)
    before = placed(bed())
    assert volumes(volume_between(before, placed(points), 1.0)) == pytest.approx([0, 12, 12])
    assert volumes(volume_between(placed(points), before, 1.0)) == pytest.approx([12, 0, -12])


def test_cut_and_fill_of_a_slope() -> None:
    """It rises by 0.5 m/m from -12.5 m to -7.5 m over 10 m, 8 m wide: a wedge of 5 m by 2.5 m on either side of -10."""
    points = bed()
    points[:, 2] = -12.5 + 0.5 * points[:, 0]
    volume = volume_to_level(placed(points), -10.0, 1.0)
    assert volumes(volume) == pytest.approx([50, 50, 0])
    assert volume.cut[1] == pytest.approx(volume.fill[1])


def test_a_level_includes_the_height_of_the_origin() -> None:
    assert volumes(volume_to_level(placed(bed(-10), georeference=HERE), -9.0, 1.0)) == pytest.approx([0, 0, 0])


def test_the_height_and_sigma_of_a_cell() -> None:
    """In one cell four points lie at -10, -10, -6.2 and -6 m; the top is the mean of the last two, within a voxel."""
    wall = np.array([[0.5, 0.5, -10], [0.4, 0.5, -6.2], [0.5, 0.4, -6.0]])
    map_ = placed(np.vstack([bed(), wall]), 0.1)
    for kind, height in (("top", -6.1), ("mean", -8.05), ("shoalest", -6.0)):
        assert volume_to_level(map_, -10.0, 1.0, kind).cut[0] == pytest.approx(10 + height)
    spread = (2 * 3.9**2 + 2 * 0.1**2) / 4
    noise = 0.1**2 + 0.1**2
    assert volume_to_level(map_, -10.0, 1.0).net[1] == pytest.approx(np.sqrt(79 * 0.1**2 + noise + spread), rel=1e-5)


def test_cells_of_one_map_alone_are_not_a_change() -> None:
    first, second = bed(-10, 6, 8), bed(-9.5, 10, 5)
    volume = volume_between(placed(first), placed(second), 1.0)
    assert (volume.compared, volume.map_only, volume.target_only) == (30, 18, 20)
    assert volumes(volume) == pytest.approx([0, 15, 15])
    with pytest.raises(InputError, match=r"no cell of 1 m in common"):
        volume_between(placed(first), placed(second + np.array([50, 0, 0])), 1.0)


def test_maps_with_different_origins_are_compared_on_the_earth() -> None:
    """The second map has its origin 3 m to the East and 1 m higher, and lies where the first does."""
    east = HERE.geodetic(np.array([[3.0, 0.0, 0.0]]))[0]
    there = Georeference(float(east[0]), float(east[1]), height=2.0)
    first, second = placed(bed(), georeference=HERE), placed(bed() - [3, 0, 0.75], georeference=there)
    volume = volume_between(
        moved(first, bed() + np.array([0.001, 0.001, 0])), moved(second, second.part.points + 0.001), 1.0
    )
    assert volume.compared == 80
    assert volumes(volume) == pytest.approx([0, 80 * 0.251, 80 * 0.251], rel=1e-3)
    with pytest.raises(InputError, match="--vertical"):
        volume_between(first, replace(second, georeference=replace(there, vertical="MSL")), 1.0)


def poses() -> tuple[RigidTransform, np.ndarray]:
    """Two tilted poses 4 m above the bed, and their covariances."""
    places = np.array([[2.0, 4.0, -6.0], [7.0, 3.0, -6.0]])
    turns = Rotation.from_euler("ZYX", [[30, 20, 170], [-70, 5, -15]], degrees=True)
    factors = np.random.default_rng(4).normal(size=(2, 6, 6)) * [[[0.004]] * 3 + [[0.02]] * 3]
    return RigidTransform.from_components(places, turns), factors @ factors.mT


def drawn(alone: bool, tries: int = 150) -> tuple[float, float]:
    """Standard deviation of the net volume over drawn errors, and its reported sigma.

    With `alone` all points belong to one scan. Otherwise each scan has half of them, and both poses err together, in
    the direction that raises their scan's points most."""
    T, covariances = poses()
    points, rng = bed(), np.random.default_rng(7)
    scan = np.zeros(len(points), int) if alone else (points[:, 0] > 5).astype(int)
    scatter = 0.05
    map_ = placed(points, scatter, scan, T, covariances)
    nets = []
    for _ in range(tries):
        if alone:
            errors = np.array([rng.multivariate_normal(np.zeros(6), each) for each in covariances])
        else:
            errors = rng.normal() * worst(points, scan, T, covariances)
        turned = T * RigidTransform.from_exp_coords(errors)
        true = (turned * T.inv())[scan].apply(points)
        true[:, :2] = points[:, :2]
        true[:, 2] += rng.normal(0, scatter, len(points))
        nets.append(volume_to_level(moved(map_, true), -10.0, 1.0).net[0])
    return float(np.std(nets)), volume_to_level(map_, -10.0, 1.0).net[1]


def worst(points: np.ndarray, scan: np.ndarray, T: RigidTransform, covariances: np.ndarray) -> np.ndarray:
    """One-sigma error (2, 6) of each pose that raises the sum of its points most, by finite differences."""
    rows = []
    for k, covariance in enumerate(covariances):
        own = points[scan == k]
        J = [
            ((T[k] * RigidTransform.from_exp_coords(1e-6 * axis) * T[k].inv()).apply(own) - own)[:, 2].sum() / 1e-6
            for axis in np.eye(6)
        ]
        rows.append(covariance @ J / np.sqrt(J @ covariance @ J))
    return np.array(rows)


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.quick_cases(1)
def test_sigma_equals_that_of_drawn_errors(alone: bool) -> None:
    spread, sigma = drawn(alone)
    assert spread == pytest.approx(sigma, rel=0.1)
    independent = 0.05 * np.sqrt(len(bed()))
    assert sigma > 3 * independent  # pose errors do not average out


def test_the_variances_of_two_maps_add() -> None:
    T, covariances = poses()
    points = bed()
    map_ = placed(points, 0.05, 0, T, covariances)
    alone = volume_to_level(map_, 0.0, 1.0).net[1]
    assert volume_between(map_, moved(map_, points + np.array([0, 0, 1])), 1.0).net[1] > alone
    certain = placed(points, 0.0)
    assert volume_between(map_, certain, 1.0).net[1] == pytest.approx(alone, rel=1e-6)


def test_seen_by_keeps_points_that_several_scans_saw() -> None:
    map_ = placed(bed())
    map_.part.columns["seen"][:30] = 1
    assert volume_to_level(map_.seen_by(2), -10.0, 1.0).compared == 50
    with pytest.raises(InputError, match="at most by 2; give a smaller --min-seen"):
        map_.seen_by(3)
