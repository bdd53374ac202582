"""The plane through noisy points, and whether its covariance is what repeated scans scatter by."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.baselines.planes.fit import PlaneFit, fit_plane, tangents

NORMAL = np.array([2.0, -1.0, 2.0]) / 3
DISTANCE = 12.0


def beams(count: int, rng: np.random.Generator) -> np.ndarray:
    """Directions (count, 3) of beams that meet the plane at up to some 45 degrees from its foot."""
    foot = tangents(NORMAL)[:3]
    directions = NORMAL + rng.uniform(-0.7, 0.9, (count, 2)) @ foot[:, :2].T
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def measure(directions: np.ndarray, sigma2: float, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) on the plane, their ranges r in error with a variance sigma2 r."""
    ranges = DISTANCE / (directions @ NORMAL)
    return directions * (ranges + rng.normal(size=len(ranges)) * np.sqrt(sigma2 * ranges))[:, None]


def squares(points: np.ndarray) -> np.ndarray:
    """Blocks of 4 m of the plane."""
    return np.floor(points @ tangents(NORMAL)[:3, :2] / 4).astype(np.int64) @ np.array([1000, 1])


def deviation(fit: PlaneFit) -> np.ndarray:
    """(3,) of (n, d) from the truth, along the tangents of the true plane."""
    return tangents(NORMAL).T @ np.append(fit.normal - NORMAL, fit.distance - DISTANCE)


def test_the_covariance_is_what_repeated_scans_scatter_by() -> None:
    """Monte Carlo: squared errors in units of the covariance average 3, and so in every direction 1."""
    errors, reported = [], []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        points = measure(beams(300, rng), 0.003, rng)
        fit = fit_plane(points, squares(points))
        basis = tangents(NORMAL)
        errors.append(deviation(fit))
        reported.append(basis.T @ fit.covariance @ basis)
    mean = np.mean(reported, axis=0)
    white = np.linalg.solve(np.linalg.cholesky(mean), np.array(errors).T)
    scatter = np.linalg.eigvalsh(white @ white.T / len(errors))
    assert scatter.min() > 0.7
    assert scatter.max() < 1.3


def test_it_turns_with_its_points_and_its_normal_keeps_its_length() -> None:
    rng = np.random.default_rng(4)
    points = measure(beams(200, rng), 0.01, rng)
    R = Rotation.from_euler("ZYX", [0.7, -0.3, 1.1])
    first, turned = (fit_plane(p, squares(points)) for p in (points, R.apply(points)))
    np.testing.assert_allclose(turned.normal, R.apply(first.normal), atol=1e-9)
    assert turned.distance == pytest.approx(first.distance, abs=1e-9)
    wide = np.eye(4)
    wide[:3, :3] = R.as_matrix()
    np.testing.assert_allclose(turned.covariance, wide @ first.covariance @ wide.T, atol=1e-10)
    np.testing.assert_allclose(first.covariance[:, :3] @ first.normal, 0, atol=1e-12)
    assert np.linalg.matrix_rank(first.covariance) == 3


def test_strays_are_left_out() -> None:
    rng = np.random.default_rng(5)
    points = measure(beams(300, rng), 1e-4, rng)
    points[:6] += 5 * NORMAL
    fit = fit_plane(points, squares(points))
    assert not fit.kept[:6].any()
    assert fit.kept[6:].mean() > 0.97
    assert np.linalg.norm(deviation(fit)) < 0.02


def test_a_bumpy_surface_is_less_certain_than_a_plane_as_noisy() -> None:
    """Whole blocks stand out together: their points do not make them more certain."""
    rng = np.random.default_rng(6)
    points = measure(beams(3000, rng), 1e-4, rng)
    block = squares(points)
    bumps = rng.normal(size=2_000_000)[block % 2_000_000] * 0.3
    even = fit_plane(points, block)
    bumpy = fit_plane(points + bumps[:, None] * NORMAL, block)
    assert bumpy.covariance[3, 3] > 20 * even.covariance[3, 3]
