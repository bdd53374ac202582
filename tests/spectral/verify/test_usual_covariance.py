"""Weights of the planes of two scans against instruments, by direction; as in `planes_root` of solve.cl."""

import numpy as np
import pytest

from sonarmap.spectral.verify.fit import CALIBRATION
from tests.kernels.surface.steps import usual_covariance

HESSIAN = np.diag([400.0, 300, 500, 90, 80, 70])


def of(shared: np.ndarray) -> np.ndarray:
    return usual_covariance(HESSIAN, shared, 0.5, CALIBRATION.usual)


def test_shared_planes_have_the_usual_covariance() -> None:
    expected = CALIBRATION.usual * 0.5 * np.linalg.inv(HESSIAN)
    np.testing.assert_allclose(of(HESSIAN), expected, rtol=1e-6)
    np.testing.assert_allclose(of(0.5 * HESSIAN), expected, rtol=1e-6)


@pytest.mark.parametrize("share", [0.0, -0.2, 0.01])
def test_information_of_noise_alone_gets_less_weight(share: float) -> None:
    shared = HESSIAN.copy()
    shared[3, 3] *= share
    ratio = np.diag(of(shared)) / np.diag(of(HESSIAN))
    np.testing.assert_allclose(ratio, [1, 1, 1, 1 / CALIBRATION.usual, 1, 1], rtol=1e-6)
