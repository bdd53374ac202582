"""The grid that scans share: its checks, its choice, and where a scan lies in it."""

import numpy as np
import pytest

from kernels.errors import InputError
from spectral.grid import Grid, choose_grid, scan_center
from spectral.scan import Scan


def box_scan(low: list[float], high: list[float], count: int = 5000, seed: int = 3) -> Scan:
    points = np.random.default_rng(seed).uniform(low, high, (count, 3)).astype(np.float32)
    return Scan(points)


@pytest.mark.parametrize(
    ("edge", "advice"), [(100, "`edge=128`"), (8, "`edge=16`"), (1000, "`edge=512`"), (0, "`edge=16`")]
)
def test_refuses_an_edge_that_is_no_power_of_two_and_says_which_is_near(edge: int, advice: str) -> None:
    with pytest.raises(InputError, match=advice):
        Grid(edge, 1.0)


@pytest.mark.parametrize("voxel", [0.0, -1.0, float("nan"), float("inf")])
def test_refuses_a_voxel_without_size(voxel: float) -> None:
    with pytest.raises(InputError, match=r"`voxel=0\.5`"):
        Grid(64, voxel)


def test_center_is_the_middle_of_the_box_whatever_a_stray_echo_says() -> None:
    scan = box_scan([10, -4, 2], [30, 6, 5])
    stray = Scan(np.vstack([scan.points, np.array([[900, 900, -900]], np.float32)]))
    np.testing.assert_allclose(scan_center(scan), [20, 1, 3.5], atol=0.2)
    np.testing.assert_allclose(scan_center(stray), scan_center(scan), atol=0.05)


def test_chosen_grid_holds_the_largest_scan_with_a_margin() -> None:
    scans = [box_scan([0, 0, 0], [3, 2, 1]), box_scan([5, 5, 5], [25, 10, 8])]
    grid = choose_grid(scans, 64)
    assert grid.edge == 64
    assert 20 * 1.1 < grid.extent < 20 * 1.25
    for scan in scans:
        voxels = grid.to_voxels(scan.points, scan_center(scan))
        assert (np.abs(voxels) < 32).all()


def test_voxel_given_is_kept() -> None:
    assert choose_grid([box_scan([0, 0, 0], [3, 2, 1])], 32, 0.7) == Grid(32, 0.7)


def test_one_place_gives_no_grid() -> None:
    with pytest.raises(InputError, match="one place"):
        choose_grid([Scan(np.ones((9, 3), np.float32))])


def test_voxels_are_relative_to_the_center_in_meters_over_voxel() -> None:
    points = np.array([[10.0, -2.0, 7.0]], np.float32)
    np.testing.assert_allclose(Grid(16, 0.5).to_voxels(points, np.array([9.0, -1.0, 4.0])), [[2, -2, 6]])
