"""Control points in a real Chromium: those of the map, those that are named by clicks, and the file of them."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.tools.products.report.page.content import Content
from tests.tools.products.report.page.browser import Opened, click, opened
from tests.tools.products.report.page.known_map import AS_WRITTEN, NAMES, A, B, path_of, saved

POINT = {
    "name": "quay, corner",
    "scan": NAMES[3],
    "point": [1.0, -2.5, 0.25],
    "known": [123.25, 50.5, -3.0],
    "estimated": [123.5, 50.0, -3.125],
    "residual": [0.25, -0.5, -0.125],
    "sigma": [0.05, 0.05, 0.05],
    "use": "control",
    "in_sigmas": 11.5,
    "left_out": False,
    "counted": True,
}


@pytest.fixture
def page(content: Content, tmp_path: Path) -> Iterator[Opened]:
    """A map of scans with names that are hard to write down."""
    with opened(path_of(content, tmp_path)) as shown:
        yield shown


def test_a_point_is_named_as_a_control_point(page: Opened, content: Content, tmp_path: Path) -> None:
    """In the frame of the scan that saw it, worked by SciPy."""
    page.page.evaluate("Object.assign(sonarmap.view.shown, {track: false, kept: false, refused: false}); 0")
    for place in (A, B):
        page.page.evaluate("sonarmap.view.leave()")  # what was picked may lie over the map
        click(page.page, place)
        page.page.get_by_role("button", name="Name as a control point").click()
    page.page.locator("#picked").get_by_label("name of").fill('quay, "north"')
    for axis, value in (("East", "12,5"), ("North", "-3.25"), ("Up", "abc")):
        page.page.locator("#picked").get_by_label(f"{axis} [m]").fill(value)
    page.page.locator("#control .save").click()
    assert '"abc"; wanted a number' in page.page.locator("#control .buttons").inner_text()
    page.page.locator("#picked").get_by_label("Up [m]").fill("")
    first, second = saved(page, "control", tmp_path)
    assert (first["name"], second["name"]) == ("point 1", 'quay, "north"')
    assert [second[name] for name in ("east_m", "north_m", "up_m", "sigma_m")] == ["12.5", "-3.25", "", "0.05"]
    assert list(first) == ["name", "scan", "x_m", "y_m", "z_m", "east_m", "north_m", "up_m", "sigma_m"]
    track = content.shown["parts"][0]["track"]
    for k, (row, place) in enumerate(((first, A), (second, B))):
        assert row["scan"] == AS_WRITTEN[k]  # A is the first point and B the second
        expected = Rotation.from_quat(track["turns"][k]).inv().apply(place - track["places"][k])
        np.testing.assert_allclose([float(row[name]) for name in ("x_m", "y_m", "z_m")], expected, atol=0.005)
    command = page.page.locator("#control .command").inner_text()
    assert " --control control.csv" in command


@pytest.mark.slow
def test_control_points_of_the_map_are_shown(content: Content, tmp_path: Path) -> None:
    check = POINT | {"name": "pile", "use": "check", "residual": [0.3, 0.0, -0.4], "in_sigmas": 1.25, "scan": NAMES[5]}
    with opened(path_of(content, tmp_path, control_points=[POINT, check])) as page:
        shown = page.page.locator("#navigation").inner_text()
        uses = ("control (the map is held to them)", "check (only compared)")
        for words in ("quay, corner", *uses, "+0.250", "−0.500", "0.5\u202fm", "11.5"):
            assert words in shown
        assert "quay, corner" in page.page.locator("#labels").inner_text()
        lines = "sonarmap.view.scene.lines.get('{}').count"
        assert page.page.evaluate(lines.format("control")) == 2 * 3
        assert page.page.evaluate(lines.format("residuals")) == 2
        residual = page.page.evaluate("(point => [point.place, point.known])(sonarmap.view.control[0])")
        np.testing.assert_allclose(np.subtract(*residual), POINT["residual"], atol=1e-9)
        track = content.shown["parts"][0]["track"]
        expected = Rotation.from_quat(track["turns"][3]).apply(POINT["point"]) + track["places"][3]
        np.testing.assert_allclose(residual[0], expected, atol=1e-6)
        row, other = saved(page, "control", tmp_path)
        expected = {"name": "quay, corner", "east_m": "123.25", "sigma_m": "0.05", "x_m": "1"}
        assert row.items() >= expected.items()
        assert other["name"] == "pile"
        page.page.locator("label.control input").uncheck()
        assert page.page.evaluate(lines.format("control")) == 0


@pytest.mark.slow
def test_grid_coordinates_checks_and_two_sigmas_have_columns_of_their_own(content: Content, tmp_path: Path) -> None:
    far = POINT | {"known": [500123.25, 6650000.5, -3.0]}
    rows = [far | {"name": "a", "use": "check"}, far | {"name": "b", "sigma": [0.02, 0.02, 0.5]}]
    with opened(path_of(content, tmp_path, control_points=rows)) as page:
        first, second = saved(page, "control", tmp_path)
        assert list(first)[5:] == ["easting_m", "northing_m", "height_m", "sigma_h_m", "sigma_v_m", "use"]
        assert [first[name] for name in ("easting_m", "height_m", "sigma_h_m", "sigma_v_m", "use")] == [
            *("500123.25", "-3", "0.05", "0.05", "check")
        ]
        assert [second[name] for name in ("sigma_h_m", "sigma_v_m", "use")] == ["0.02", "0.5", "control"]
        assert "--control-crs EPSG:CODE" in page.page.locator("#control .command").inner_text()
        for axis in ("East", "North"):
            page.page.locator("#control").get_by_label(f"{axis} [m] of a").fill("12.5")
        page.page.locator("#control .save").click()
        assert "wanted one of them for all" in page.page.locator("#control .buttons").inner_text()


@pytest.mark.slow
def test_positions_that_were_left_out_are_shown(content: Content, tmp_path: Path) -> None:
    track = content.shown["parts"][0]["track"]
    with opened(path_of(content, tmp_path, wrong_fixes={track["scans"][3]: [30.5, -7.25]})) as page:
        (piece,) = page.page.evaluate("sonarmap.view.wrong")
        np.testing.assert_allclose(piece, [track["places"][3], [30.5, -7.25, track["places"][3][2]]], atol=1e-9)
        count = "sonarmap.view.scene.lines.get('wrong').count"
        assert page.page.evaluate(count) == 1 + 3  # a line to a cross
        page.page.locator("label.wrong input").uncheck()
        assert page.page.evaluate(count) == 0
    with opened(path_of(content, tmp_path)) as page:
        assert page.page.locator("label.wrong").count() == 0
