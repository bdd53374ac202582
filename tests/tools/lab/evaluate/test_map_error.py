"""A map against what is truly there: known offsets, a simulation's surface, a cloud, and files that are neither."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.lab.evaluate.map_error import map_error, read_points, reference_of
from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.simulated import COARSE, QUIET

GRID = np.stack(np.meshgrid(np.arange(20.0), np.arange(10.0), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)


def test_a_cloud_that_is_off_by_known_lengths(tmp_path: Path) -> None:
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


def test_what_a_simulation_saw_lies_on_its_surface(tmp_path: Path) -> None:
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


def test_what_is_no_reference_is_refused(tmp_path: Path) -> None:
    for name in ("truth.tum", "missing.json", "missing.ply", "nothing"):
        with pytest.raises(InputError, match=name):
            reference_of(tmp_path / name)
