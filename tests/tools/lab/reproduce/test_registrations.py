"""Cells of registrations with known errors."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.reproduce.registrations import claims, errors, nees, refused, registrar

TRUTH = RigidTransform.from_components([3.0, -1.0, 0.5], Rotation.from_euler("ZYX", [0.7, -0.2, 0.1]))
COVARIANCE = np.diag(np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.4]) ** 2)


@pytest.mark.parametrize("axis", range(6))
def test_the_nees_of_one_sigma_along_any_body_axis_is_one(axis: int) -> None:
    """T_true = T_estimate Exp(xi): the tangent is the source's, rotation first."""
    xi = np.eye(6)[axis] * np.sqrt(np.diag(COVARIANCE))
    estimate = TRUTH * RigidTransform.from_exp_coords(xi).inv()
    assert nees(estimate, COVARIANCE, TRUTH) == pytest.approx(1.0, rel=1e-9)
    assert nees(estimate, COVARIANCE / 4, TRUTH) == pytest.approx(4.0, rel=1e-9)


def test_the_nees_without_a_covariance_is_nan() -> None:
    for covariance in (np.full((6, 6), np.nan), np.zeros((6, 6))):
        assert math.isnan(nees(TRUTH, covariance, TRUTH))


def test_cells_have_errors_and_sigmas() -> None:
    estimate = TRUTH * RigidTransform.from_components([0.0, 0.0, 0.6], Rotation.from_euler("x", 5, degrees=True))
    registration = Registration(estimate, COVARIANCE, 21.0, 0.6, True, 9.9, "so")
    cells = errors(registration, TRUTH, 0.25) | claims(registration)
    assert cells["rotation_deg"] == pytest.approx(5.0)
    assert cells["translation_voxels"] == pytest.approx(2.4)
    assert cells["right"] is True
    assert errors(registration, TRUTH, 0.19)["right"] is False
    assert (cells["sigma_deg"], cells["sigma_m"]) == (pytest.approx(np.rad2deg(0.03)), pytest.approx(0.4))
    assert 9.9 not in cells.values()


def test_cells_of_a_refused_registration_are_nan() -> None:
    cells = errors(refused("why"), TRUTH, 0.25) | claims(refused("why"))
    assert (cells["right"], cells["accepted"], cells["reason"]) == (False, False, "why")
    assert all(math.isnan(float(cells[key])) for key in ("nees", "psr", "probability", "sigma_m"))


def test_the_tilt_bound_is_lifted_in_methods_that_have_one(device: Device) -> None:
    bounded, free = (registrar("hemisphere", Grid(16, 1.0), device.selector, bound) for bound in (None, math.pi))
    # pyrefly: ignore[missing-attribute]
    assert (bounded.config.max_tilt, free.config.max_tilt) == (math.radians(35), math.pi)
    registrar("icp", Grid(16, 1.0), None, math.pi)
