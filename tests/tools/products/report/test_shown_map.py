"""The map in 3D in Chromium: opening, measuring, picking, and keys."""

from base64 import b64encode
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.products.report.content import Content
from sonarmap.tools.products.report.points import pack
from tests.tools.products.report.browser import Opened, click, opened, seen_at
from tests.tools.products.report.known_map import QUANTUM, VOXEL, A, B, known_points, unpack, written


@pytest.fixture(scope="module")
def shown(content: Content, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    """The page of the known points."""
    with opened(written(content, tmp_path_factory.mktemp("page") / "report.html")) as page:
        yield page


@pytest.fixture
def page(shown: Opened) -> Opened:
    """The page, reset to its state after opening."""
    shown.page.evaluate("sonarmap.view.measure(false); sonarmap.view.camera.reset(); scrollTo(0, 0)")
    return shown


def test_the_page_requests_nothing_and_logs_nothing(page: Opened) -> None:
    assert page.console == []
    assert [address for address in page.requests if not address.startswith("data:")] == [page.page.url]
    assert "8 scans lie in one map" in page.page.locator("#verdict").inner_text()


def test_javascript_unpacks_the_same_points_as_python(page: Opened, content: Content) -> None:
    columns = {"scan": np.arange(60) % 8, "wide": np.arange(60) * 70_000}
    data, layout = pack(100 * known_points(), columns, VOXEL)  # many tiles
    points, same = unpack(data, layout)
    got = page.page.evaluate(
        """async ([packed, base64]) => {
            const points = await sonarmap.unpack(packed, base64);
            const places = Array.from({ length: points.count }, (_, k) => sonarmap.placeOf(points, k));
            return { places, scan: [...points.columns.scan], wide: [...points.columns.wide] };
        }""",
        [layout, b64encode(data).decode()],
    )
    np.testing.assert_array_equal(got["places"], points)
    assert (got["scan"], got["wide"]) == (same["scan"].tolist(), same["wide"].tolist())


def test_two_points_are_measured_within_the_quantization(page: Opened) -> None:
    """By mouse: the distance is within twice half a quantum along each axis."""
    page.page.locator("#measure").click()
    click(page.page, A)
    assert "second point" in page.page.locator("#picked").inner_text()
    click(page.page, B)
    measured = np.array(page.page.evaluate("sonarmap.view.measured"))
    assert np.abs(measured - [A, B]).max() <= QUANTUM / 2 + 1e-9
    distance = float(np.linalg.norm(B - A))
    assert abs(float(np.linalg.norm(measured[1] - measured[0])) - distance) <= QUANTUM * np.sqrt(3)
    text = page.page.locator("#picked dd").first.inner_text()
    assert abs(float(text.split()[0]) - distance) <= QUANTUM * np.sqrt(3) + 0.0005


@pytest.fixture
def bare(page: Opened) -> Iterator[Opened]:
    """The map from above, without track and loops."""
    lines = "Object.assign(sonarmap.view.shown, {{track: {0}, kept: {0}, refused: {0}}}); 0"
    page.page.evaluate(lines.format("false"))
    page.page.evaluate("sonarmap.view.camera.fromAbove()")
    yield page
    page.page.evaluate(lines.format("true"))


def picked(page: Opened, place: np.ndarray) -> dict[str, Any] | None:
    """Pick at the canvas position of a place [m]."""
    return page.page.evaluate("([x, y]) => sonarmap.view.pick(x, y)", seen_at(page.page, place))


def test_every_visible_point_is_picked(bare: Opened) -> None:
    """From above few points cover each other; every other pick gives the point and its scan."""
    page, right = bare, 0
    for k, point in enumerate(known_points()):
        hit = picked(page, point)
        assert hit is not None
        if np.abs(np.array(hit["place"]) - point).max() <= QUANTUM / 2 + 1e-9:
            right += 1
            scan = page.page.evaluate("k => sonarmap.view.points.columns.scan[k]", hit["point"])
            assert scan == k % 8
        else:  # another point covers it
            assert hit["place"][2] > point[2]
    assert right > 50
    assert page.page.evaluate("sonarmap.view.pick(2, 2)") is None


def test_points_hidden_by_the_height_slider_are_not_picked(bare: Opened) -> None:
    """With everything above 1.5 m hidden, A at 0.8 m is picked and B at 2.1 m is not."""
    page = bare
    heights = known_points()[:, 2]
    low, high = (page.page.evaluate(f"sonarmap.view.part.extent[{k}][2]") for k in (0, 1))
    assert low <= heights.min() < heights.max() <= high + QUANTUM
    slider = page.page.locator("#highest")
    slider.fill(str(round(200 * (1.5 - low) / (high - low))))
    assert abs(page.page.evaluate("sonarmap.view.heights[1]") - 1.5) <= (high - low) / 400
    for place, seen in ((A, True), (B, False)):
        hit = picked(page, place)
        assert (hit is not None and np.abs(np.array(hit["place"]) - place).max() < QUANTUM) == seen
    slider.fill("200")
    assert page.page.evaluate("sonarmap.view.heights[1] === Infinity")


def test_degrees_are_those_of_the_georeference(page: Opened) -> None:
    """JavaScript and Python agree to a millimeter for any heading, also 25 km from the origin."""
    places = np.array([[0.0, 0.0, 0.0], [812.5, -333.25, -41.0], [-25_000.0, 9_000.0, 120.0]])
    for here in (Georeference(60.3913, 5.3221, -4.5), Georeference(-33.85, -179.999, 12.0, heading=217.5)):
        expected = here.geodetic(places)[:, :2]
        arguments = [places.tolist(), here.to_json()]
        got = page.page.evaluate("([places, here]) => places.map(place => sonarmap.degreesOf(place, here))", arguments)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-8)


def test_a_loop_is_shown_with_its_reason(page: Opened, content: Content) -> None:
    pair = content.shown["pairs"][0]
    page.page.locator("#loops tbody .link").first.click()
    assert pair["reason"] in page.page.locator("#picked").inner_text()
    assert page.page.evaluate("sonarmap.view.scene.lines.get('chosen').count") == 1


def test_keys_turn_move_and_zoom(page: Opened) -> None:
    page.page.locator("#canvas").focus()
    state = "(c => [c.azimuth, c.elevation, c.distance, ...c.target])(sonarmap.view.camera)"
    before = np.array(page.page.evaluate(state))
    for key, changed in (("ArrowLeft", [0]), ("ArrowDown", [1]), ("+", [2]), ("Shift+ArrowRight", [3, 4])):
        page.page.keyboard.press(key)
        after = np.array(page.page.evaluate(state))
        differ = np.flatnonzero(np.abs(after - before) > 1e-12).tolist()
        assert [k for k in differ if k < 3 or changed[0] > 2] == changed
        before = after
    page.page.keyboard.press("Home")
    page.page.keyboard.press("m")
    assert page.page.locator("#measure").get_attribute("aria-pressed") == "true"
    page.page.keyboard.press("Escape")
    assert page.page.locator("#measure").get_attribute("aria-pressed") == "false"
