"""The observability along the least constrained directions, and the choice of these directions."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.verifier import BANDS, Observability, weakest


def trench(seed: int, closed: bool) -> np.ndarray:
    """(9000, 3) a straight one along x, of unlike sides [m]; where it is closed, with walls across."""
    rng = np.random.default_rng(seed)
    x, u = rng.uniform(-14, 14, 9000), rng.uniform(0, 1, 9000)
    side = rng.integers(3, size=9000)
    y = np.choose(side, [-5 + 0 * u, 6 + 3 * u, -5 + 11 * u])
    z = np.choose(side, [5 * u, 3 * u, 0 * u])
    points = np.column_stack([x, y, z])
    if closed:
        across = rng.integers(4, size=9000) == 0
        points[across] = np.column_stack([np.where(u < 0.4, -6.0, 5.0), y, 4 * rng.uniform(0, 1, 9000) * (0.5 + u)])[
            across
        ]
    return points + rng.normal(0, 0.02, points.shape)


def seen_at_truth(closed: bool) -> Observability:
    registrar = SpectralRegistrar(choose_device(), Grid(64, 0.5))
    target, source = (registrar.prepare(Scan(trench(seed, closed).astype(np.float32))) for seed in (1, 2))
    between = (source.volume.center - target.volume.center) / 0.5
    information = np.diag([3.0, 2.0, 1.0, 0.01, 5.0, 6.0])
    fit = Fit(Rotation.identity(), between, information, 0.1, 3000.0)
    return registrar._verifier.observe_directions(target, source, fit).read()


def test_a_trench_is_unconstrained_along_its_length_only() -> None:
    seen = seen_at_truth(closed=False)
    np.testing.assert_allclose(np.abs(seen.axes), np.eye(3), atol=1e-9)
    assert seen.slides.shape == (3, len(BANDS), 2)
    along, aside, up = seen.slides[:, :, 1]
    assert (along[:2] > 0.4).all()
    assert (along > 1.5 * aside).all()
    assert (aside > 1.5 * up).all()


def test_cross_walls_constrain_it() -> None:
    opened, closed = seen_at_truth(closed=False), seen_at_truth(closed=True)
    assert (closed.slides[0, :, 1] < 0.95 * opened.slides[0, :, 1]).all()


def test_the_weakest_directions_are_of_marginal_information() -> None:
    """A turn about z and a shift along y are nearly equivalent: only the information on their difference counts."""
    J = np.zeros((50, 6))
    rng = np.random.default_rng(3)
    J[:, 2] = 10 + 0.1 * rng.normal(size=50)
    J[:, 4] = 1.0
    J[:, [0, 1, 3, 5]] = rng.normal(size=(50, 4))
    turns, shifts = weakest(J.T @ J)
    assert abs(turns[2, 0]) > 0.9
    assert abs(shifts[1, 0]) > 0.9
    R = Rotation.from_euler("ZYX", [0.5, 0.2, -0.3]).as_matrix()
    both = np.kron(np.eye(2), R)
    turned, shifted = weakest(both @ (J.T @ J) @ both.T)
    np.testing.assert_allclose(np.abs(turned.T @ R @ turns), np.eye(3), atol=1e-6)
    np.testing.assert_allclose(np.abs(shifted.T @ R @ shifts), np.eye(3), atol=1e-6)
