"""The covariance of refined poses: unconstrained directions, invariances, and calibration."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.covariance import Slide, covers, fit_covariance
from sonarmap.spectral.grid import Grid, choose_grid, coarse_edge
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.verify.fit import Fit, PriorTerm
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis
from sonarmap.spectral.verify.verifier import Observability
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, pair_error
from sonarmap.tools.lab.simulate.random_pairs import evaluation_pair
from tests.samples.scenes.structures import registered

T_TARGET_SOURCE = RigidTransform.from_components([2.0, -3.0, 1.5], Rotation.from_euler("ZYX", [8, 3, -4], degrees=True))
COUNT, REACH = 12_000, 45.0  # points of a scan, and how far they go [m]


def wall(rng: np.random.Generator, noise: float) -> np.ndarray:
    """Points of a wall at x = 30 that runs along y, and of the floor before it."""
    half = COUNT // 2
    upright = rng.normal(30.0, noise, half), rng.uniform(-REACH, REACH, half), rng.uniform(-15.0, 25.0, half)
    floor = rng.uniform(-20.0, 30.0, half), rng.uniform(-REACH, REACH, half), rng.normal(-15.0, noise, half)
    return np.hstack([upright, floor]).T


def register(target: np.ndarray, source: np.ndarray, voxel: float = 1.0) -> Registration:
    """Two sets of points on a grid of 128 voxels."""
    return registered(SpectralRegistrar(choose_device(None), Grid(128, voxel)), target, source)


def side_of_a_hull(rng: np.random.Generator) -> np.ndarray:
    """Points of a cylinder along y, 6 m ahead, seen by beams on a grid: the same at any position along it."""
    azimuth, elevation = np.meshgrid(np.deg2rad(np.linspace(-45, 45, 128)), np.deg2rad(np.linspace(-20, 20, 64)))
    x, y, z = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    beams = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    radius, axis = 8.0, 14.0
    across, toward = beams[:, 0] ** 2 + beams[:, 2] ** 2, axis * beams[:, 0]
    under_root = toward**2 - across * (axis**2 - radius**2)
    seen = under_root > 0
    ranges = (toward[seen] - np.sqrt(under_root[seen])) / across[seen]
    return beams[seen] * (ranges + rng.normal(0.0, 0.1, len(ranges)))[:, None]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("seed", [9, 2])
def test_the_pattern_of_the_beams_constrains_nothing(seed: int) -> None:
    """Scans of a hull's side from two places along it agree best where the sensor has not moved."""
    rng = np.random.default_rng(seed)
    found = register(side_of_a_hull(rng), side_of_a_hull(rng), voxel=0.16)
    assert not found.accepted
    sigma = np.sqrt(np.linalg.eigvalsh(found.covariance[3:, 3:])[-1])
    assert sigma > 5.0


def corner(rng: np.random.Generator) -> np.ndarray:
    """Points of a floor and two walls at right angles, which constrain all directions."""
    across = rng.uniform(-20.0, 30.0, COUNT), rng.normal(-40.0, 0.3, COUNT), rng.uniform(-15.0, 25.0, COUNT)
    return np.vstack([wall(rng, 0.3), np.transpose(across)])


@pytest.mark.slow
def test_errors_are_within_the_covariance() -> None:
    """On 48 pairs of a sensor that stands still, with exact ranges: 88 % and more within the 95 % ellipsoid.

    Most are far within: the covariance grants that ranges are off and scans bent, which nothing in a pair shows.
    """
    squared = []
    for number in range(48):
        target, source, truth = evaluation_pair(number, 4242, "yaw").scans()
        grid = choose_grid((target, source))
        registrar = SpectralRegistrar(choose_device(None), grid)
        registration = registrar.register(registrar.prepare(target), registrar.prepare(source))
        if pair_error(registration.T_target_source, truth).within(RIGHT_DEG, RIGHT_VOXELS * grid.voxel):
            error = (registration.T_target_source.inv() * truth).as_exp_coords()
            squared.append(float(error @ np.linalg.solve(registration.covariance, error)))
    mean, within = np.mean(squared), np.mean(np.array(squared) < chi2.ppf(0.95, 6))
    print(f"{len(squared)} right, mean {mean:.2f}, within 95 %: {within:.2f}")
    assert len(squared) > 30
    assert mean < 8
    assert within >= 0.88


def test_covers_means_inside_the_ellipsoid() -> None:
    T = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.2, 0.1, -0.9]))
    sigmas = np.array([0.01, 0.02, 0.03, 0.1, 5.0, 0.2])
    for axis in range(6):
        for length, inside in ((0.99, True), (1.01, False)):
            away = np.zeros(6)
            away[axis] = length * np.sqrt(chi2.ppf(0.95, 6)) * sigmas[axis]
            assert covers(np.diag(sigmas**2), T, T * RigidTransform.from_exp_coords(away)) == inside


def by_scans(fit: Fit) -> np.ndarray:
    """Covariance (6, 6) of a fit with a clear peak."""
    hypothesis: Any = SimpleNamespace(fit=fit, evidence=SimpleNamespace(psr=60.0))
    return fit_covariance(hypothesis, (np.zeros(3), np.zeros(3)), Grid(128, 0.5)).by_scans


def test_without_pairs_of_points_the_sigmas_are_huge() -> None:
    """If a pose leaves the scans nothing in common, sigmas are ten times half a turn and the grid's edge, so that even
    many such pairs do not fix a pose in a graph."""
    zeros = {"doubt": np.zeros(6), "stretch": np.zeros(2), "stretching": np.zeros((2, 8))}
    fit = Fit(Rotation.identity(), np.zeros(3), np.zeros((6, 6)), 0.0, 0.0, 0.3, **zeros)
    np.testing.assert_allclose(np.sqrt(np.diag(by_scans(fit))), 10 * np.repeat([np.pi, 64.0], 3), rtol=1e-3)


def shift_sigmas(fit: Fit) -> np.ndarray:
    return np.sqrt(np.linalg.eigvalsh(by_scans(fit)[3:, 3:]))


@pytest.mark.parametrize("edge", [64, 256])
def test_the_variance_grows_with_the_correlation_along_a_direction(edge: int) -> None:
    """It is added to that of the planes, in voxels of the coarse grid, and is 0 without correlation beside the peak."""
    axes = Rotation.from_euler("ZYX", [0.4, -0.2, 0.1]).as_matrix()
    slides = np.full((3, 3, 2), 0.02)
    slides[0] = 1.0
    grid, slide = Grid(edge, 0.5), Slide(odds=-1.0, weight=2.0, reach=6.0)
    seen = Observability(axes, slides, np.full(2, 0.5))
    assert slide.variance(seen, grid)[1:].tolist() == [0.0, 0.0]
    coarse_voxel = edge / coarse_edge(edge)
    assert slide.variance(seen, grid)[0] == pytest.approx((1 / (1 + np.e) - 0.03) * (6 * coarse_voxel) ** 2)
    hypothesis = Hypothesis(Fit(Rotation.identity(), np.zeros(3), np.eye(6) * 1000, 0.1, 3000.0, 0.1), 0.4, 20.0)
    hypothesis = replace(hypothesis, evidence=Evidence(psr=50.0))
    middle = np.zeros(3), np.zeros(3)
    before, after = (fit_covariance(hypothesis, middle, grid, some, slide).posterior for some in (None, seen))
    opened, variances = (after - before)[3:, 3:], slide.variance(seen, grid) * grid.voxel**2
    np.testing.assert_allclose(opened, (axes * variances) @ axes.T, rtol=0.05, atol=0.02 * variances[0])


@pytest.mark.parametrize("off", [0.0, 5.0, 9.0])
def test_instruments_exclude_slides_by_bayes_rule(off: float) -> None:
    """The share of slides among draws that are `off` voxels from where instruments with a sigma of 4 voxels are."""
    share, reach, sigma, rng = 0.3, 12.0, 4.0, np.random.default_rng(8)
    slid = rng.random(4_000_000) < share
    away = np.where(slid, rng.normal(0, reach, len(slid)), 0.0) - rng.normal(0, sigma, len(slid))
    drawn = slid[np.abs(away - off) < 0.25].mean()
    turn = Rotation.from_euler("ZYX", [0.5, -0.3, 0.8])
    slides = np.stack([np.full((3, 2), value) for value in (0.02, 1.0, 0.02)])
    seen = Observability(turn.as_matrix(), slides, np.full(2, 0.5))
    grid = Grid(64, 0.5)
    slide = Slide(float(np.log(0.33 / 0.67)), weight=20.0, reach=reach * coarse_edge(grid.edge) / grid.edge)
    residual = np.concatenate([np.zeros(3), off * turn.as_matrix()[:, 1]])
    covariance = np.diag(np.repeat([0.01, sigma], 3) ** 2)
    prior = PriorTerm(residual, np.eye(6), covariance, np.zeros((6, 6)))
    variance = slide.variance(seen, grid, prior)
    assert variance[[0, 2]].tolist() == [0.0, 0.0]
    assert variance[1] == pytest.approx(drawn / (sigma**-2 + reach**-2), rel=0.03)
    # those of a vehicle's usual motion do not: it is learned from poses that may have slid
    assert slide.variance(seen, grid)[1] == pytest.approx(share * reach**2)


@pytest.mark.slow
def test_it_is_symmetric_and_positive_and_grows_with_the_voxel() -> None:
    """A scene twice as large on voxels twice as large has the same sigmas of turns and twice those of shifts."""
    rng = np.random.default_rng(5)
    target, source = corner(rng), T_TARGET_SOURCE.inv().apply(corner(rng))
    small, large = register(target, source), register(2 * target, 2 * source, voxel=2.0)
    units = np.repeat([1.0, 2.0], 3)
    np.testing.assert_allclose(large.covariance, small.covariance * np.outer(units, units), rtol=1e-3, atol=1e-12)
    np.testing.assert_array_equal(small.covariance, small.covariance.T)
    assert np.linalg.eigvalsh(small.covariance).min() > 0


def test_insignificant_information_does_not_constrain() -> None:
    """A direction whose information is within its error is unconstrained; one far above it is not."""
    share = np.array([1e-3, 0.02, 0.1, 0.2, 0.3, 0.4])

    def sigmas(doubt: float) -> np.ndarray:
        information = np.diag(share) * 3000
        return shift_sigmas(Fit(Rotation.identity(), np.zeros(3), information, 0.1, 3000.0, 0.3, np.full(6, doubt)))

    np.testing.assert_allclose(sigmas(1e-5), sigmas(0.0), rtol=1e-2)
    assert (sigmas(0.03) >= sigmas(0.0)).all()
    assert sigmas(0.11)[-1] > 20 * sigmas(0.0)[-1]
