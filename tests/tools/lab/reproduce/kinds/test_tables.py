"""What is right and believed by kind, on rows made by hand, the words around it, and refits."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds import tables
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import (
    Linear,
    calibration_beside,
    expected_error,
    fit_probability,
    fit_variance,
    left_out_table,
    refitted_nees,
    refitted_probabilities,
    reported_table,
    usual_error,
)
from sonarmap.tools.lab.reproduce.kinds.run import Kinds
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NAVIGATION, KindsSettings
from sonarmap.tools.lab.reproduce.pages.folder import section_text, verdicts
from sonarmap.tools.lab.reproduce.rows import column, right, where
from tests.samples.experiments.shown import show
from tests.tools.lab.reproduce.kinds.rows import fixed, row

NAVIGATED = {name: value for number in (1, 2, 3) for name, value in fixed(0.1, 0.1, 1.0, number).items()}
ROWS = (
    *(row(number=number) for number in range(9)),
    row(number=9, right=False, accepted=False, nees=9e9, probability=0.05),
    row(number=10, right=False, relief="flat"),
    *(row(kind="swath", number=number, right=number < 6, accepted=number < 4) for number in range(8)),
    *(row(priors=LEVELED, number=number, accepted=number > 0) for number in range(4)),
    row(priors=NAVIGATION, kind="swath", right=False, **NAVIGATED),
    row(method="planes", right=False),
)


class TestTables:
    def test_ours_beside_the_others_names_the_worst_kind(self) -> None:
        lines = {line[0]: line[1:] for line in tables.beside_others(ROWS)}
        assert lines["right, known: nothing"] == (
            "15/18 [0.61..0.94]; worst kind: swath 75 % [41..93]",
            "best: planes 0 %",
            "expect 83 of 100 to be right",
        )
        assert lines["believed, of the right, known: nothing"][0].endswith("worst kind: swath 67 % [30..90]")
        assert lines["wrong and believed, known: nothing"][0].endswith("worst kind: patch 9 % [2..38]")
        assert lines["wrong and believed, known: nothing"][1] == "best: planes 100 %"
        assert lines["right, known: attitude, depth"][0].endswith("worst kind: patch 100 % [51..100]")
        assert [line[0] for line in tables.beside_others([row(right=False)])] == [
            "right, known: nothing",
            "wrong and believed, known: nothing",
        ]
        assert tables.beside_others(ROWS[-1:]) == []

    def test_kinds_the_worst_first(self) -> None:
        assert tables.worst_first(ROWS) == ["swath", "patch"]
        lines = [("swath", "nothing", "8"), ("patch", "attitude, depth", "4"), ("patch", "nothing", "10")]
        assert [line[:3] for line in tables.kind_table(ROWS).rows] == lines
        flat = row(relief="flat", right=False, accepted=False)
        assert tables.kind_table([flat, *ROWS[:8]]).rows[0][2] == "8"

    def test_methods_beside_each_other_and_flat_scenes_apart(self) -> None:
        assert tables.every_variant(ROWS) == [("spectral", "none"), ("spectral", LEVELED), ("planes", "none")]
        table, reliefs = tables.method_table(ROWS), tables.relief_table(ROWS)
        assert table.headings == ("kind", "pairs", "spectral", "spectral, known: attitude, depth", "planes")
        assert table.rows == (
            ("swath", "8", "75 %, 67 %, 0", "–", "–"),
            ("patch", "10", "90 %, 100 %, 0", "100 %, 75 %, 0", "0 %, –, 1"),
            ("all kinds", "18", "83 %, 87 %, 0", "100 %, 75 %, 0", "0 %, –, 1"),
        )
        assert reliefs.rows[0] == ("flat (cannot fix a pose)", "1", "0 %, –, 1", "–", "–")
        assert reliefs.rows[1][0] == "rich"


class TestCalibration:
    def test_the_expected_error_is_weighted_over_ten_bins(self) -> None:
        rows = [row(probability=p, right=r) for p, r in ((0.95, True), (0.91, False), (0.25, False), (1.0, True))]
        top = abs((0.95 + 0.91 + 1.0) / 3 - 2 / 3) * 3 / 4
        assert expected_error(rows) == pytest.approx(top + 0.25 / 4)
        assert math.isnan(expected_error([row(probability=math.nan)]))

    def test_what_an_exact_probability_leaves_shrinks_with_the_number_and_away_from_the_middle(self) -> None:
        def left(p: float, count: int) -> float:
            return usual_error([row(probability=p)] * count)

        for p in (0.5, 0.9):  # the mean of a normal deviation is 0.8 of its standard deviation
            assert left(p, 400) == pytest.approx(0.8 * math.sqrt(p * (1 - p) / 400), rel=0.06)
        assert left(0.0, 9) == left(1.0, 9) == 0.0
        assert usual_error([*[row(probability=0.55)] * 50, *[row(probability=0.45)] * 50]) > 1.3 * left(0.55, 100)
        assert math.isnan(usual_error([row(probability=math.nan)]))

    def test_by_kind_and_by_what_is_known(self) -> None:
        lines = {line[0]: line[1:] for line in reported_table(ROWS).rows}
        assert list(lines)[:2] == ["swath", "patch"]
        assert lines["swath"][3:5] == ("6", "100.0 % [61.0 %..100.0 %]")
        assert lines["all kinds, known: attitude, depth"][:2] == ("4", "0.050")
        assert lines["swath, known: navigation"][:4] == ("1", "0.950", "0.093", "0")
        lines = {line[0]: line[1:] for line in calibration_beside(ROWS)}
        assert lines["expected calibration error of the probability, as reported"][0].endswith("kind: swath 0.200")
        assert lines["truths in the 95 % ellipsoid, as reported"][0].startswith("100 %; farthest from 95 %")
        assert left_out_table(ROWS).rows == ()

    def test_a_kind_is_left_out_where_there_is_evidence(self) -> None:
        rows = [
            row(kind=kind, number=number, right=number % 3 > 0, evidence_p_a=float(number), evidence_c_a=float(number))
            for kind in ("swath", "patch")
            for number in range(30)
        ]
        lines = [(line[0], line[1], line[4]) for line in left_out_table(rows).rows]
        assert lines == [("swath", "30", "20"), ("patch", "30", "20"), ("all kinds", "60", "40")]
        words = [line[0].rpartition(", ")[2] for line in calibration_beside(rows)]
        assert words == [*["as reported"] * 2, *["fitted to the other kinds alone"] * 2]


class TestSection:
    EXPERIMENT = Kinds(KindsSettings(kinds=("patch", "swath"), pairs=12), None)

    def test_words_and_pictures(self, tmp_path: Path) -> None:
        section = show(self.EXPERIMENT, tmp_path, ROWS)
        assert len(verdicts(section)) == 6 + 2 + 2
        text = section_text(section, 1)
        assert "15 pairs of each kind (set 77014): `patch`, a patch merged" in text
        assert "Left out, because the scene has no such pair: 4 of `patch`, 7 of `swath`." in text
        assert "share 5 to 40 % and are registered with navigation" in text

    def test_without_ours_there_is_nothing_to_compare(self, tmp_path: Path) -> None:
        section = show(self.EXPERIMENT, tmp_path, ROWS[-1:])
        assert (verdicts(section), set(section.pictures)) == ((), {"kinds.png"})


KINDS = ("patch", "swath", "imaging")


def slopes(fit: Linear, columns: int) -> np.ndarray:
    """The constant and the slope of each column of a fitted function, in the columns' own units."""
    values = fit(np.vstack([np.zeros(columns), np.eye(columns)]))
    return np.append(values[0], values[1:] - values[0])


def synthetic(count: int, seed: int = 3, odds: float = 2.0) -> list[Row]:
    """Rows with log odds of -1 + odds p_a - 0.5 p_b of being right, whose variances are off by exp(1 + 0.7 c_x)."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(count):
        a, b, x = rng.normal(size=3) * (1.0, 3.0, 0.8)
        is_right = bool(rng.uniform() < expit(-1 + odds * a - 0.5 * b))
        nees = float(rng.chisquare(6) * np.exp(1 + 0.7 * x))
        evidence = {"evidence_p_a": a, "evidence_p_b": b, "evidence_c_x": x}
        rows.append(
            row(kind=KINDS[number % 3], number=number, right=is_right, nees=nees, probability=is_right / 2, **evidence)
        )
    return rows


class TestFits:
    def test_the_weights_of_the_odds_come_back(self) -> None:
        rows = synthetic(6000)
        columns = np.array([[row["evidence_p_a"], row["evidence_p_b"]] for row in rows], float)
        are_right = np.array([bool(row["right"]) for row in rows])
        assert slopes(fit_probability(columns, are_right), 2) == pytest.approx([-1.0, 2.0, -0.5], abs=0.15)

    def test_the_weights_of_the_variance_come_back(self) -> None:
        rng = np.random.default_rng(5)
        columns = rng.normal(size=(4000, 2)) * (2.0, 0.1) + (10.0, 0.0)
        nees = rng.chisquare(6, 4000) * np.exp(columns @ (0.4, -3.0) - 2.0)
        assert slopes(fit_variance(columns, nees), 2) == pytest.approx([-2.0, 0.4, -3.0], abs=0.2)

    def test_what_is_separable_constant_or_far_from_chi_squared_stays_finite(self) -> None:
        columns = np.column_stack([np.arange(20.0), np.full(20, 7.0)])
        log_odds = fit_probability(columns, columns[:, 0] > 9)(columns)
        assert np.isfinite(log_odds).all()
        assert (expit(log_odds) > 0.5).tolist() == (columns[:, 0] > 9).tolist()
        for nees, times in ((12.0, 2), (6e6, 1e6)):
            fitted = fit_variance(columns[:, 1:], np.full(20, nees))(columns[:2, 1:])
            assert fitted == pytest.approx([math.log(times)] * 2)


class TestLeftOut:
    def test_what_holds_in_all_kinds_is_calibrated_in_the_one_left_out(self) -> None:
        rows = synthetic(3000)
        refitted, scaled = refitted_probabilities(rows), refitted_nees(rows)
        assert column(refitted, "number").tolist() == column(rows, "number").tolist()
        assert column(scaled, "number").tolist() == column(right(rows), "number").tolist()
        for kind in KINDS:
            assert expected_error(where(refitted, kind=kind)) < 0.06 < expected_error(where(rows, kind=kind))
            assert column(where(scaled, kind=kind), "nees").mean() == pytest.approx(6.0, abs=0.8)

    def test_a_kinds_own_rows_have_no_part_in_its_fit(self) -> None:
        rows = synthetic(600)
        changed = [{**row, "right": not row["right"]} if row["kind"] == "swath" else row for row in rows]
        refitted = [refitted_probabilities(some) for some in (rows, changed)]
        for kind, alike in (("swath", True), ("patch", False)):
            before, after = ([row["probability"] for row in where(some, kind=kind)] for some in refitted)
            assert (before == after) == alike

    def test_a_kind_where_the_evidence_means_something_else_shows(self) -> None:
        rows = [row for row in synthetic(3000) if row["kind"] != "swath"]
        rows += where(synthetic(3000, 4, odds=-2.0), kind="swath")
        assert expected_error(where(refitted_probabilities(rows), kind="swath")) > 0.2

    def test_rows_without_evidence_are_left_out(self) -> None:
        rows, bare = synthetic(60), [row(kind=kind) for kind in KINDS]
        assert refitted_probabilities(bare) == refitted_nees(bare) == []
        assert len(refitted_probabilities([*rows, *bare, {**rows[0], "evidence_p_a": math.nan}])) == len(rows)
        assert refitted_probabilities(where(rows, kind="patch")) == []
