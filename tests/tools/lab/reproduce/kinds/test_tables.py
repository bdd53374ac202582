"""What is right and believed by kind, on rows made by hand, and the words around it."""

import math
from pathlib import Path

import pytest

from sonarmap.tools.lab.reproduce.folder import verdicts
from sonarmap.tools.lab.reproduce.kinds import tables
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import (
    calibration_beside,
    expected_error,
    reported_table,
    usual_error,
)
from sonarmap.tools.lab.reproduce.kinds.run import Kinds
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NAVIGATION, KindsSettings
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


class TestSection:
    EXPERIMENT = Kinds(KindsSettings(kinds=("patch", "swath"), pairs=12), None)

    def test_claims_and_pictures(self, tmp_path: Path) -> None:
        section = show(self.EXPERIMENT, tmp_path, ROWS)
        assert len(verdicts(section)) == 6 + 2 + 2

    def test_without_ours_there_is_nothing_to_compare(self, tmp_path: Path) -> None:
        section = show(self.EXPERIMENT, tmp_path, ROWS[-1:])
        assert (verdicts(section), set(section.pictures)) == ((), {"kinds.png"})
