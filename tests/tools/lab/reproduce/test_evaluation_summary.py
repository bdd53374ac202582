"""The arithmetic of the evaluation's tables, on rows made by hand, and normalized errors of known ones."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.reproduce.answer import claims, errors, nees, refused
from sonarmap.tools.lab.reproduce.calibration_tables import (
    calibration,
    reliability,
)

TRUTH = RigidTransform.from_components([3.0, -1.0, 0.5], Rotation.from_euler("ZYX", [0.7, -0.2, 0.1]))
COVARIANCE = np.diag(np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.4]) ** 2)


def row(**cells: object) -> dict:
    """A right, believed registration by ours, but for what is told."""
    usual = {"turn": "yaw", "number": 0, "scene": "harbor", "sigma2": 1.0, "shared": 0.7, "method": "spectral"}
    errors = {"rotation_deg": 0.2, "translation_voxels": 0.4, "translation_m": 0.5, "nees": 5.0}
    return usual | errors | {"right": True, "accepted": True, "probability": 0.97} | cells


class TestNees:
    @pytest.mark.parametrize("axis", range(6))
    def test_one_deviation_along_any_axis_of_the_body_counts_one(self, axis: int) -> None:
        """T_true = T_estimate Exp(xi): the tangent is the source's, rotation first."""
        xi = np.eye(6)[axis] * np.sqrt(np.diag(COVARIANCE))
        estimate = TRUTH * RigidTransform.from_exp_coords(xi).inv()
        assert nees(estimate, COVARIANCE, TRUTH) == pytest.approx(1.0, rel=1e-9)
        assert nees(estimate, COVARIANCE / 4, TRUTH) == pytest.approx(4.0, rel=1e-9)

    def test_draws_from_the_covariance_are_calibrated(self) -> None:
        rng = np.random.default_rng(np.random.SeedSequence([7]))
        mixed = rng.standard_normal((6, 6))
        covariance = 1e-2 * mixed @ mixed.T / 6 + 1e-4 * np.eye(6)
        draws = rng.multivariate_normal(np.zeros(6), covariance, 400)
        estimates = [TRUTH * RigidTransform.from_exp_coords(xi).inv() for xi in draws]
        calibrated = calibration([row(nees=nees(T, covariance, TRUTH)) for T in estimates])
        small = calibration([row(nees=nees(T, covariance / 2, TRUTH)) for T in estimates])
        assert calibrated is not None
        assert small is not None
        assert calibrated.verdict == "within the interval"
        assert calibrated.inside.low < 0.95 < calibrated.inside.high
        assert small.verdict == "the covariance is too small"
        assert small.mean == pytest.approx(2 * calibrated.mean)

    def test_no_covariance_no_number(self) -> None:
        for covariance in (np.full((6, 6), np.nan), np.zeros((6, 6))):
            assert math.isnan(nees(TRUTH, covariance, TRUTH))
        assert calibration([row(nees=math.nan)]) is None


class TestAnswer:
    def test_cells(self) -> None:
        estimate = TRUTH * RigidTransform.from_components([0.0, 0.0, 0.6], Rotation.from_euler("x", 5, degrees=True))
        registration = Registration(estimate, COVARIANCE, 21.0, 0.6, True, 9.9, "so")
        cells = errors(registration, TRUTH, 0.25) | claims(registration)
        assert cells["rotation_deg"] == pytest.approx(5.0)
        assert cells["translation_voxels"] == pytest.approx(2.4)
        assert cells["right"] is True
        assert errors(registration, TRUTH, 0.19)["right"] is False
        assert (cells["sigma_deg"], cells["sigma_m"]) == (pytest.approx(np.rad2deg(0.03)), pytest.approx(0.4))
        assert 9.9 not in cells.values()

    def test_what_is_refused_says_nothing(self) -> None:
        cells = errors(refused("why"), TRUTH, 0.25) | claims(refused("why"))
        assert (cells["right"], cells["accepted"], cells["reason"]) == (False, False, "why")
        assert all(math.isnan(float(cells[key])) for key in ("nees", "psr", "probability", "sigma_m"))


class TestArithmetic:
    def test_calibration_of_hand_made_errors(self) -> None:
        calibrated = calibration([row(nees=value) for value in (1.0, 2.0, 12.5, 12.6, math.nan)])
        assert calibrated is not None
        assert (calibrated.mean, calibrated.median) == (pytest.approx(28.1 / 4), 7.25)
        assert (calibrated.low, calibrated.high) == pytest.approx(chi2.ppf([0.025, 0.975], 24) / 4)
        assert (calibrated.inside.successes, calibrated.inside.trials) == (3, 4)  # the 95 % quantile is 12.59

    def test_reliability_counts_each_row_once(self) -> None:
        probabilities = (0.0, 0.1, 0.1, 0.995, 1.0, math.nan)
        right = (False, False, True, True, True, True)
        bins = reliability([row(probability=p, right=r) for p, r in zip(probabilities, right, strict=True)])
        assert [(rated.low, rated.high, rated.right.successes, rated.right.trials) for rated in bins] == [
            (0.0, 0.05, 0, 1),
            (0.05, 0.2, 1, 2),
            (0.99, 1.0, 2, 2),
        ]
        assert [rated.predicted for rated in bins] == pytest.approx([0.0, 0.1, 0.9975])
