"""Tables of rows: groups, shares and medians; and measures of single experiments."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from sonarmap.tools.lab.reproduce.experiments import Row
from sonarmap.tools.lab.reproduce.paper_tables import deviations, last_right, reach
from sonarmap.tools.lab.reproduce.render import Table, count, frame_of, number, render, share, where
from sonarmap.tools.lab.reproduce.tables import INSIDE, KINDS, PAIRS, directions, expected_error, usual_error

ROWS: list[Row] = [
    {"method": "a", "kind": "x", "right": True, "accepted": True, "error": 1.0},
    {"method": "a", "kind": "y", "right": False, "accepted": True, "error": math.nan},
    {"method": "b", "kind": "x", "right": True, "accepted": False, "error": 4.0},
    {"method": "b", "kind": "x", "right": True, "accepted": True, "error": 2.0},
    {"method": "b", "other": 1},
]


def test_a_table_has_a_line_for_each_group_and_a_total() -> None:
    cells = {"n": count(), "right": share("right", "accepted", "plain"), "error": number("error", 1, condition="right")}
    rendered = render(Table("T", ("method",), cells, "kind == kind", total="all"), frame_of(ROWS))
    assert rendered is not None
    assert rendered.headings == ("method", "n", "right", "error")
    assert rendered.rows == (("a", "2", "1/2", "1.0"), ("b", "2", "1/1", "3.0"), ("all", "4", "2/3", "2.0"))
    assert rendered.markdown().startswith("**T**\n\n| method | n |")
    assert render(Table("T", ("method",), cells, "kind == 'z'"), frame_of(ROWS)) is None
    assert render(Table("T", ("method",), cells, "unknown == 1"), frame_of(ROWS)) is None


def test_columns_by_value_have_a_dash_where_there_is_none() -> None:
    rendered = render(Table("T", ("method",), {"": share("right", form="percent")}, "", "kind"), frame_of(ROWS[:4]))
    assert rendered is not None
    assert rendered.headings == ("method", "x", "y")
    assert rendered.rows == (("a", "100 % [21..100]", "0 % [0..79]"), ("b", "100 % [34..100]", "–"))


def test_booleans_with_missing_values_can_be_negated() -> None:
    assert len(where(frame_of(ROWS), "not accepted")) == 1


def test_bins_are_in_ascending_order() -> None:
    rows: list[Row] = [
        {"set": "overlap", "turn": "yaw", "method": "spectral", "shared": shared, "right": shared > 0.5, "scene": "x"}
        for shared in (0.95, 0.1, 0.2, 0.55)
    ]
    rendered = render(PAIRS[0], frame_of(rows))
    assert rendered is not None
    assert rendered.headings[2:] == ("0..0.2", "0.4..0.6", "0.8..1")
    assert [cell.split(" [")[0] for cell in rendered.rows[0][2:]] == ["0 %", "100 %", "100 %"]


def test_the_last_right_scan_is_before_the_first_failure() -> None:
    wrong = {4: (7, 9), 5: (), 6: (0, 5)}
    rows: list[Row] = [{"seed": s, "scan": k, "right": k not in wrong[s]} for s in wrong for k in range(10)]
    assert last_right(frame_of(rows), "scan", "seed") == last_right(frame_of(rows[::-1]), "scan", "seed") == [6, 9, -1]


def test_the_reach_ends_before_the_first_wrong_distance() -> None:
    rows: list[Row] = [{"distance_m": d, "right": d != 30} for d in (40, 10, 30, 20)]
    assert reach(frame_of(rows)) == 20
    assert reach(frame_of([{"distance_m": 1, "right": False}])) == 0


def test_deviations_wrap_around_the_circle() -> None:
    row = {f"{which}_{name}_deg": 10.0 for which in ("true", "found") for name in ("yaw", "roll", "pitch")}
    frame = deviations(frame_of([row | {"true_yaw_deg": 88.0, "found_yaw_deg": -270.0}, row | {"found_yaw_deg": 5.0}]))
    assert frame["yaw_off"].tolist() == pytest.approx([2, 5])


def test_the_calibration_error_of_hand_made_probabilities() -> None:
    frame = frame_of([{"probability": p, "right": right} for p, right in ((0.05, False), (0.95, True), (1.0, True))])
    assert expected_error(frame) == pytest.approx((0.05 + 0.05) / 3)
    assert 0 < usual_error(frame) < 0.3
    assert math.isnan(usual_error(frame_of([{"probability": math.nan}])))
    draws = chi2(6).rvs(4000, random_state=np.random.default_rng(1))
    assert len(where(frame_of([{"nees": x} for x in draws]), INSIDE)) / 4000 == pytest.approx(0.95, abs=0.01)


def kind_row(**changes: object) -> Row:
    """Row of a right, accepted spectral registration without navigation, with `changes`."""
    place = {"kind": "patch", "number": 1, "scene": "harbor", "relief": "rich", "shared": 0.5, "priors": "none"}
    answer = {"right": True, "accepted": True, "nees": 5.0, "probability": 0.95}
    # pyrefly: ignore[bad-return]
    return {**place, "method": "spectral", **answer, **changes}


def test_the_worst_kind_is_first_and_flat_scenes_do_not_count() -> None:
    swaths = [kind_row(kind="swath", number=number, right=number < 6, accepted=number < 4) for number in range(8)]
    rows = [*(kind_row(number=number) for number in range(10)), *swaths, kind_row(relief="flat", right=False)]
    rendered = render(KINDS[0], frame_of([*rows, kind_row(method="icp", right=False)]))
    assert rendered is not None
    assert [row[0] for row in rendered.rows] == ["swath", "patch", "all kinds"]
    assert rendered.rows[0][1:] == ("75 %, 67 %, 0", "–")


def test_a_direction_is_fixed_if_registration_is_far_better_than_navigation() -> None:
    cells = {"sigma_m": 0.5, "navigation_sigma_m": 2.0, "error_m": -0.3, "navigation_error_m": 1.0}
    row = {
        f"direction{k}_{name}": k * value if name == "sigma_m" else value
        for k in (1, 2, 3)
        for name, value in cells.items()
    }
    frame = directions(frame_of([kind_row(priors="navigation", **row), kind_row()]))
    assert frame["fixed"].tolist() == [True, False, False]
    assert frame["error_m"].tolist() == [0.3] * 3
