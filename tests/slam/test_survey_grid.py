"""A survey's voxel: it stays the same when scans are added or a scan is useless."""

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.scan import Scan


def scan(size: float, seed: int = 0) -> Scan:
    points = np.random.default_rng(seed).uniform(0, size, (2000, 3)) * [1.0, 0.6, 0.3]
    return Scan(points.astype(np.float32))


SIZES = np.random.default_rng(1).uniform(40, 47, 30)
SURVEY = [scan(size, k) for k, size in enumerate(SIZES)]


def test_the_grid_holds_the_largest_scan_with_little_to_spare() -> None:
    grid, exact = survey_grid(SURVEY, 64), choose_grid(SURVEY, 64)
    assert exact.voxel <= grid.voxel < 1.0906 * exact.voxel
    assert np.log2(grid.voxel) * 8 == pytest.approx(round(np.log2(grid.voxel) * 8))


def test_added_scans_keep_the_grid() -> None:
    whole = survey_grid(SURVEY)
    largest = int(np.argmax(SIZES))
    kept = [survey_grid(SURVEY[:count]) == whole for count in range(12, 30)]
    assert sum(kept) >= 12
    assert all(kept[max(0, largest - 11) :])


def test_stray_echoes_do_not_make_the_grid_coarse() -> None:
    noise = scan(400.0, 99)
    assert survey_grid([*SURVEY, noise]) == survey_grid(SURVEY)
    # in a small survey every scan counts
    assert survey_grid([*SURVEY[:3], noise]).voxel > 5 * survey_grid(SURVEY[:3]).voxel


def test_a_given_voxel_is_kept_and_scans_of_one_point_are_left_out() -> None:
    assert survey_grid(SURVEY, 32, 0.7) == Grid(32, 0.7)
    point = Scan(np.ones((9, 3), np.float32))
    assert survey_grid([*SURVEY, point]) == survey_grid(SURVEY)
    with pytest.raises(InputError, match="one place"):
        survey_grid([point, point])
