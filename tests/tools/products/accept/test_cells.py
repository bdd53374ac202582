"""Depths and their uncertainties: laws, and a bed whose depths are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import RigidTransform
from scipy.special import erf

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.pose_covariance import joint_covariance
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Map, read_map_folder
from sonarmap.tools.files.readers.trajectory import read_graph_json
from sonarmap.tools.products.accept.cells import VERTICAL, DepthCells, circle_radius, depth_cells
from sonarmap.tools.products.accept.crossings import crossing_check, relative_sigmas
from tests.tools.products.accept.made_up import DEPTH, SLOPE, bed, map_folder, strip
from tests.tools.products.accept.measured import joined, measured

DRAWS = 400


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Map:
    return read_map_folder(map_folder(tmp_path_factory.mktemp("accept") / "map", bed(0.0)))


def centers(cells: DepthCells) -> np.ndarray:
    return (np.column_stack([cells.column, cells.row]) + cells.low + 0.5) * cells.cell


def drawn(folder: Map) -> np.ndarray:
    """(DRAWS, n, 6) errors of the poses, left tangents, from their joint covariance."""
    count = len(folder.parts[0].scans)
    joint = joint_covariance(read_graph_json(folder.path / "graph.json"), range(count))
    draws = np.random.default_rng(6).multivariate_normal(np.zeros(6 * count), joint, DRAWS, method="cholesky")
    return draws.reshape(DRAWS, count, 6)


def moved(points: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Points (M, 3) moved by errors (M, 6) of the poses that saw them."""
    return RigidTransform.from_exp_coords(error).apply(points)


def test_depths_are_those_of_a_plane_at_the_cells_centers(folder: Map) -> None:
    cells = depth_cells(folder, 1.25)
    np.testing.assert_allclose(cells.depth, DEPTH - centers(cells) @ SLOPE, atol=1e-3)
    np.testing.assert_allclose(cells.slope, np.tile(SLOPE, (len(cells.depth), 1)), atol=1e-3)
    assert cells.soundings.sum() == 5 * len(folder.parts[0].points)
    assert (cells.passes == 3).all()
    placed = depth_cells(replace(folder, georeference=Georeference(60.0, 9.0, height=2.5)), 1.25)
    np.testing.assert_allclose(placed.depth, cells.depth - 2.5)


def test_the_scatter_is_that_of_the_soundings(tmp_path: Path) -> None:
    cells = depth_cells(read_map_folder(map_folder(tmp_path / "map", bed(0.08))), 1.0)
    assert np.sqrt((cells.scatter**2).mean()) == pytest.approx(0.08, rel=0.05)
    np.testing.assert_allclose(cells.terms["noise"], VERTICAL * cells.scatter)


def test_stated_variances_equal_the_scatter_of_depths_over_many_draws(folder: Map) -> None:
    cells, part = depth_cells(folder, 1.0), folder.parts[0]
    at = {tuple(place): k for k, place in enumerate(centers(cells).tolist())}
    chosen = [at[place] for place in ((2.5, 3.5), (6.5, 4.5), (10.5, 1.5), (12.5, 7.5))]
    depths = np.empty((DRAWS, len(chosen)))
    shifts = np.empty((DRAWS, len(chosen), 3))
    inside = [np.floor(part.points[:, :2]) == np.floor(centers(cells)[k]) for k in chosen]
    for draw, errors in enumerate(drawn(folder)):
        points = moved(part.points, errors[strip(part.points)])
        for n, members in enumerate(members.all(axis=1) for members in inside):
            shifts[draw, n] = (points - part.points)[members].mean(axis=0)
            # the depth that the moved soundings show at the center, on the bed's slope
            away = centers(cells)[chosen[n]] - points[members, :2].mean(axis=0)
            depths[draw, n] = -points[members, 2].mean() - away @ SLOPE
    stated = np.hypot(cells.terms["poses"], cells.terms["slope"])[chosen] / VERTICAL
    np.testing.assert_allclose(depths.std(axis=0), stated, rtol=0.12)
    for n, k in enumerate(chosen):
        sigmas = np.sqrt(np.linalg.eigvalsh(np.cov(shifts[:, n, :2].T)))
        assert circle_radius(sigmas[None])[0] == pytest.approx(cells.thu[k], rel=0.12)
        assert (np.linalg.norm(shifts[:, n, :2], axis=1) <= cells.thu[k]).mean() == pytest.approx(0.95, abs=0.03)


def test_predicted_crossings_equal_the_scatter_over_many_draws(folder: Map) -> None:
    joint = joint_covariance(read_graph_json(folder.path / "graph.json"), range(4))
    pairs, places = np.array([[0, 2], [3, 1]]), np.array([[3.0, 8.0, -7.0], [11.0, -2.0, -6.5]])
    errors = drawn(folder)
    differences = [
        [np.diff([moved(place[None], each[k][None])[0, 2] for k in pair])[0] for each in errors]
        for pair, place in zip(pairs.tolist(), places, strict=True)
    ]
    predicted = relative_sigmas(joint, pairs, places)
    np.testing.assert_allclose(np.std(differences, axis=1), predicted, rtol=0.1)
    check = crossing_check(folder)
    assert (check.pairs, check.observed_m, check.lines_observed_m) == (2, pytest.approx(0.0425), None)
    assert check.predicted_m is not None
    assert 0.2 < check.predicted_m / (0.6745 * predicted.mean()) < 5


@pytest.mark.parametrize("ratio", [0.02, 0.3, 0.8, 1.0])
def test_the_circle_holds_95_percent(ratio: float) -> None:
    radius = circle_radius(np.array([[3 * ratio, 3.0]]))[0]

    def within(x: float) -> float:
        rest = np.sqrt(radius**2 - x**2) / (3 * ratio)
        return np.exp(-((x / 3) ** 2) / 2) / np.sqrt(2 * np.pi) / 3 * erf(rest / np.sqrt(2))

    assert quad(within, -radius, radius)[0] == pytest.approx(0.95, abs=1e-3)


def test_the_datum_adds_to_depths_and_positions(folder: Map) -> None:
    without, with_datum = depth_cells(folder, 1.0), depth_cells(folder, 1.0, (0.4, 0.07))
    steep = float(SLOPE @ SLOPE)
    np.testing.assert_allclose(with_datum.tvu**2 - without.tvu**2, VERTICAL**2 * (0.07**2 + steep * 0.4**2), rtol=0.02)
    assert (with_datum.thu > np.hypot(without.thu, 2.4 * 0.4) * 0.97).all()


def test_the_correction_of_a_lever_arm_counts_by_its_size(tmp_path: Path) -> None:
    numbers = {"forward": 0.5, "left": -1.8, "turn": 0.0, "late": 0.0, "drift_east": 0.0, "drift_north": 0.0}
    folder = read_map_folder(map_folder(tmp_path / "map", systematic={**numbers, "alternative": None, "reason": ""}))
    thu = depth_cells(folder, 1.0).thu
    size = np.hypot(0.5, 1.8)
    assert (thu > 0.97 * size).all()
    assert (thu < 1.6 * size).all()
    exact = replace(folder, summary={**folder.summary, "systematic": None})
    assert depth_cells(exact, 1.0).thu.max() < 0.5 * size


@pytest.mark.slow
def test_depths_of_a_simulated_survey_are_within_their_uncertainty(tmp_path: Path) -> None:
    """With errors of the navigation drawn anew ten times; `measured.py` does so for 20 surveys."""
    _, once, again = next(measured(tmp_path, 10))
    every = joined([once, *again])
    assert 0.9 <= (np.abs(every.total) <= every.tvu).mean() <= 1.0
    assert 0.85 <= (np.abs(every.poses) <= every.by_poses).mean() <= 0.995


def test_impossible_cells_are_refused(folder: Map) -> None:
    with pytest.raises(InputError, match="larger ones"):
        depth_cells(folder, 1e-4)
    with pytest.raises(InputError, match="larger one"):
        depth_cells(folder, 0.01)
