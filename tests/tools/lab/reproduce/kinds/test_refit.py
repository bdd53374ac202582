"""Fits of the probability and of the covariance's scale: known weights come back, and a kind left out has no say."""

import math

import numpy as np
import pytest
from scipy.special import expit

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import (
    Linear,
    expected_error,
    fit_probability,
    fit_variance,
    refitted_nees,
    refitted_probabilities,
)
from sonarmap.tools.lab.reproduce.rows import where
from tests.tools.lab.reproduce.kinds.rows import row

KINDS = ("patch", "swath", "imaging")


def slopes(fit: Linear, columns: int) -> np.ndarray:
    """The constant and the slope of each column of a fitted function, in the columns' own units."""
    at = np.vstack([np.zeros(columns), np.eye(columns)])
    values = fit(at)
    return np.append(values[0], values[1:] - values[0])


def synthetic(count: int, seed: int = 3, odds: float = 2.0) -> list[Row]:
    """Rows with log odds of -1 + odds p_a - 0.5 p_b of being right, whose variances are off by exp(1 + 0.7 c_x)."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(count):
        a, b, x = rng.normal(size=3) * (1.0, 3.0, 0.8)
        right = bool(rng.uniform() < expit(-1 + odds * a - 0.5 * b))
        nees = float(rng.chisquare(6) * np.exp(1 + 0.7 * x))
        evidence = {"evidence_p_a": a, "evidence_p_b": b, "evidence_c_x": x}
        rows.append(
            row(kind=KINDS[number % 3], number=number, right=right, nees=nees, probability=float(right) / 2, **evidence)
        )
    return rows


class TestFits:
    def test_the_weights_of_the_odds_come_back(self) -> None:
        rows = synthetic(6000)
        columns = np.array([[row["evidence_p_a"], row["evidence_p_b"]] for row in rows], float)
        right = np.array([bool(row["right"]) for row in rows])
        assert slopes(fit_probability(columns, right), 2) == pytest.approx([-1.0, 2.0, -0.5], abs=0.15)

    def test_the_weights_of_the_variance_come_back(self) -> None:
        rng = np.random.default_rng(5)
        columns = rng.normal(size=(4000, 2)) * (2.0, 0.1) + (10.0, 0.0)
        nees = rng.chisquare(6, 4000) * np.exp(columns @ (0.4, -3.0) - 2.0)
        assert slopes(fit_variance(columns, nees), 2) == pytest.approx([-2.0, 0.4, -3.0], abs=0.2)

    def test_what_is_separable_and_what_is_constant_stays_finite(self) -> None:
        columns = np.column_stack([np.arange(20.0), np.full(20, 7.0)])
        log_odds = fit_probability(columns, columns[:, 0] > 9)(columns)
        assert np.isfinite(log_odds).all()
        assert (expit(log_odds) > 0.5).tolist() == (columns[:, 0] > 9).tolist()
        assert fit_variance(columns[:, 1:], np.full(20, 12.0))(columns[:2, 1:]) == pytest.approx([math.log(2)] * 2)

    def test_errors_far_from_the_chi_squared_are_fitted_too(self) -> None:
        assert fit_variance(np.ones((9, 1)), np.full(9, 6e6))(np.ones((1, 1))) == pytest.approx([math.log(1e6)])


class TestLeftOut:
    def test_what_holds_in_all_kinds_is_calibrated_in_the_one_left_out(self) -> None:
        rows = synthetic(3000)
        refitted = refitted_probabilities(rows)
        assert [row["number"] for row in refitted] == [row["number"] for row in rows]
        for kind in KINDS:
            assert expected_error(where(refitted, kind=kind)) < 0.06 < expected_error(where(rows, kind=kind))
        scaled = refitted_nees(rows)
        assert [row["number"] for row in scaled] == [row["number"] for row in rows if row["right"]]
        for kind in KINDS:
            assert np.mean([float(row["nees"]) for row in where(scaled, kind=kind)]) == pytest.approx(6.0, abs=0.8)

    def test_a_kinds_own_rows_have_no_part_in_its_fit(self) -> None:
        rows = synthetic(600)
        changed = [{**row, "right": not row["right"]} if row["kind"] == "swath" else row for row in rows]
        before, after = (
            [row["probability"] for row in where(refitted_probabilities(some), kind="swath")]
            for some in (rows, changed)
        )
        assert before == after
        others = [
            [row["probability"] for row in where(refitted_probabilities(some), kind="patch")]
            for some in (rows, changed)
        ]
        assert others[0] != others[1]

    def test_a_kind_where_the_evidence_means_something_else_shows(self) -> None:
        rows = [row for row in synthetic(3000) if row["kind"] != "swath"]
        rows += [row for row in synthetic(3000, 4, odds=-2.0) if row["kind"] == "swath"]
        refitted = refitted_probabilities(rows)
        assert expected_error(where(refitted, kind="swath")) > 0.2

    def test_rows_without_evidence_are_left_out(self) -> None:
        rows = synthetic(60)
        bare = [row(kind=kind) for kind in KINDS]
        unknown = [{**rows[0], "evidence_p_a": math.nan}]
        assert refitted_probabilities(bare) == refitted_nees(bare) == []
        assert len(refitted_probabilities([*rows, *bare, *unknown])) == len(rows)
        assert refitted_probabilities(where(rows, kind="patch")) == []
