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
    calibration_table,
    reliability,
    reliability_table,
    shared,
)
from sonarmap.tools.lab.reproduce.evaluation.pairs_section import (
    accuracy_table,
    beside_others,
    overlap_table,
    scene_table,
    trust_table,
)
from sonarmap.tools.lab.reproduce.rows import percent, rate
from sonarmap.tools.lab.reproduce.table import Table

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

    def test_shares_of_the_points_in_common(self) -> None:
        rows = [row(shared=value) for value in (0.2, 0.4, 0.41, 1.0)]
        assert [len(shared(rows, 0.2, 0.4)), len(shared(rows, 0.4))] == [1, 2]
        assert percent(rows[:3], rows) == "75 % [30..95]"
        assert (rate([], []), percent([], [])) == ("–", "–")


class TestTables:
    ROWS = (
        row(shared=0.1, right=False, accepted=False),
        row(shared=0.3, right=False, accepted=True),
        row(shared=0.5, right=True, accepted=False),
        row(shared=0.7, rotation_deg=0.4, translation_voxels=0.1),
        row(shared=0.9, rotation_deg=0.1, translation_voxels=0.2),
        row(shared=0.9, sigma2=2.0, rotation_deg=5.0, scene="pool"),
        row(shared=0.9, method="kiss", right=False),
    )

    def test_success_and_trust(self) -> None:
        """By overlap, by what is accepted, by scene; and accuracy of what shares much, under little noise."""

        def begins(table: Table) -> list[str]:
            return [" ".join(cell.split()[0] for cell in line) for line in table.rows]

        methods = ("spectral", "kiss")
        table = overlap_table(self.ROWS, methods, "t")
        spans = ("0%..20% (1 pairs)", "20%..40% (1 pairs)", "40%..60% (1 pairs)", "60%..80% (1 pairs)")
        assert table.headings == ("method", *spans, "80%..100% (2 pairs)", "all")
        assert begins(table) == ["spectral 0 0 100 100 100 4/6", "kiss – – – – 0 0/1"]
        assert begins(trust_table(self.ROWS, methods, "t")) == [
            "spectral 4/6 1/6 1/4 1/4 1/4",
            "kiss 1/1 1/1 1/1 0/1 –",
        ]
        scenes = scene_table(self.ROWS, methods[:1])
        assert scenes.headings == ("method", "harbor", "pool")
        assert [cell.rpartition(",")[2] for cell in scenes.rows[0][1:]] == [" 1", " 0"]
        assert accuracy_table(self.ROWS, methods).rows == (("spectral", "2", "0.250", "0.150", "0.500"),)

    def test_ours_beside_the_others(self) -> None:
        lines = beside_others(self.ROWS, ()).rows
        assert [line[1].split()[0] for line in lines] == ["1/6", "1/4", "0.250", "0.150", "5.00;", "100.0%"]
        assert [line[2] for line in lines[:2]] == ["best: kiss 100 %", "best: kiss 0 %"]
        assert lines[0][3] == "expect 17 of 100 pairs to be accepted though wrong"
        assert lines[2][3] == "half of such registrations are within 0.250 ° of the truth"
        assert lines[-1][3] == "expect 100 of 100 truths in the 95 % ellipsoid"
        assert beside_others([row(method="kiss")], ()).rows == ()

    def test_calibration_and_probability(self) -> None:
        lines = {line[0]: line for line in calibration_table(self.ROWS, (), ("spectral", "kiss")).rows}
        assert lines["spectral, any yaw"][1] == "4"
        assert lines["… 80%..100% shared"][1] == "2"
        assert lines["… σ² = 2 m²"][1] == "1"
        assert "kiss, any yaw" not in lines
        assert reliability_table(self.ROWS, self.ROWS[:1]).rows == (
            ("any yaw", "0.95..0.99", "0.970", "0.667", "4/6 [0.30..0.90]"),
            ("any rotation", "0.95..0.99", "0.970", "0.000", "0/1 [0.00..0.79]"),
        )
