"""The live page in Chromium: a dive, the alarm, hostile texts, and a lost server."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.live.growing import Pose
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import State, coverage
from sonarmap.tools.products.live.server import LivePage
from sonarmap.tools.products.report.content import Content
from sonarmap.tools.products.report.page import report_text
from tests.tools.products.live.known_dive import KnownDive
from tests.tools.products.report.browser import SOFTWARE, Opened, browsed, wait_until


@contextmanager
def opened(
    live: LivePage, width: int = 1280, flags: tuple[str, ...] = SOFTWARE, silent: bool = True
) -> Iterator[Opened]:
    """The live page; at exit it must have requested only its own address and, if `silent`, logged nothing."""
    with browsed(live.address, "window.sonarmap && sonarmap.wire.open", (width, 844), flags) as shown:
        yield shown
        assert shown.console == [] or not silent
        assert {urlsplit(url).netloc for url in shown.requests} <= {urlsplit(live.address).netloc, ""}


def publish(live: LivePage, dive: KnownDive, keys: int) -> None:
    for message in dive.until(keys):
        live.publish(message)


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.quick_cases(1)
def test_the_page_shows_a_dive_and_an_alarm_when_lost(width: int) -> None:
    dive = KnownDive(per_scan=300)
    with LivePage() as live, opened(live, width) as shown:
        page = shown.page
        assert "Waiting for the first scan." in page.inner_text("#state")
        publish(live, dive, 20)
        wait_until(
            page, "sonarmap.dive.clouds.size === 20 && document.querySelector('#said').textContent.includes('20 key')"
        )
        assert "6,000 points of 20 key scans" in page.inner_text("#said")
        assert page.inner_text("#status") == "placed"
        assert "59 of 60" in page.inner_text("#sentence")
        figures = ("0.4\u202fm/s", "3:12", "70°", "2.1\u202fm", "6.8\u202fm")
        assert [text for text in figures if text not in page.inner_text("#facts")] == []
        assert "once" in page.inner_text("#coverage")
        assert page.is_hidden("#alarm")
        live.publish(dive.state(19, lost=61.0))
        wait_until(page, "!document.querySelector('#alarm').hidden")
        assert "Go back to the last sure place" in page.inner_text("#alarm")
        assert page.inner_text("#status") == "LOST"
        assert "Lost for 61 s" in page.inner_text("#sentence")
        assert page.title().startswith("LOST")
        wait_until(page, "sonarmap.view.scene.lines.get('sure')?.count === 3")
        page.click("#sure")
        assert page.get_attribute("#follow", "aria-pressed") == "false"
        live.publish(dive.state(19))
        wait_until(page, "document.querySelector('#alarm').hidden")
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_new_poses_move_clouds_without_resending_them() -> None:
    with LivePage() as live, opened(live) as shown:
        page = shown.page
        spot = np.random.default_rng(0).normal(0, 0.2, (500, 3)) + np.array([3, 0, 0])
        live.publish(messages.cloud(0, spot))
        for y in (5.0, -5.0):
            # the sensor's x axis lies along y
            T = RigidTransform.from_components([0.0, y, 0.0], Rotation.from_rotvec([0, 0, np.pi / 2]))
            after = T * RigidTransform.from_translation([1.0, 0.0, 0.0])
            for message in messages.poses(0, [Pose(0, each, np.zeros((6, 6))) for each in (T, after)]):
                live.publish(message)
            wait_until(
                page, f"Math.abs(sonarmap.view.camera.center[1] - {y + 3}) < 0.3 && sonarmap.dive.samples(0).length"
            )
            assert abs(page.evaluate("sonarmap.dive.samples(0)[0][1]") - y - 3) < 1
            pieces = page.evaluate("sonarmap.dive.trackPieces(0)[0].flat()")
            np.testing.assert_allclose(pieces, [0, y, 0, 0, y + 1, 0], atol=1e-3)
            colored = """async () => {
                const { view } = sonarmap, { gl } = view.scene;
                view.camera.reset(); view.draw(performance.now());
                const pixels = new Uint8Array(4 * gl.canvas.width * gl.canvas.height);
                gl.readPixels(0, 0, gl.canvas.width, gl.canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
                return pixels.filter((value, k) => k % 4 === 1 && value > 120).length;
            }"""
            assert page.evaluate(colored) > 50
        assert page.evaluate("sonarmap.wire.messages") < 10


@pytest.mark.slow
def test_the_page_shows_a_lost_server_and_reconnects() -> None:
    with LivePage() as live:
        port = urlsplit(live.address).port or 0
        browser = opened(live, silent=False)
        shown = browser.__enter__()
        publish(live, KnownDive(per_scan=50), 5)
        wait_until(shown.page, "sonarmap.dive.clouds.size === 5")
    try:
        wait_until(shown.page, "document.querySelector('#link').textContent.includes('no connection')")
        assert shown.page.evaluate("document.body.classList.contains('stale')")
        with LivePage(port=port) as again:
            again.publish(("state", State("waiting", alerts=("again",)).message))
            wait_until(shown.page, "document.querySelector('#concerns').textContent === 'again'")
            assert shown.page.is_hidden("#link")
            assert shown.page.evaluate("sonarmap.dive.clouds.size + sonarmap.view.scene.clouds.size") == 0
    finally:
        browser.__exit__(None, None, None)


RESTED = """async () => {
    const { view } = sonarmap, { show } = view.scene;
    view.budget = 4000;
    view.fit = () => {};
    const whole = new Promise((shown) => (view.scene.show = function (camera, look) {
        show.call(this, camera, look);
        if (!look.alone) shown(look.slices);
    }));
    for (let k = 0; k < 40; k++) {
        view.camera.turn(0.01, 0);
        view.request(true);
        await new Promise((passed) => setTimeout(passed, 20));
    }
    return whole;
}"""


def pixels(picture: bytes) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(picture)).convert("RGB")).astype(int)


@pytest.mark.parametrize(("keys", "slices"), [(20, 12), (130, 18)])
@pytest.mark.quick_cases(1)
def test_a_view_at_rest_is_drawn_in_slices_as_it_is_at_once(keys: int, slices: int) -> None:
    with LivePage() as live, opened(live) as shown:
        page, canvas = shown.page, shown.page.locator("#canvas")
        publish(live, KnownDive(per_scan=40_000 // keys), keys)
        loaded = f"sonarmap.dive.state.keys === {keys} && sonarmap.dive.clouds.size === {keys} && sonarmap.dive.last"
        wait_until(page, f"{loaded} && !sonarmap.view.refreshing && !sonarmap.view.waiting")
        assert page.evaluate(RESTED) == slices
        in_slices = pixels(canvas.screenshot())
        page.evaluate("sonarmap.view.budget = Infinity; sonarmap.view.request()")
        wait_until(page, "!sonarmap.view.waiting")
        page.wait_for_timeout(500)
        apart = np.abs(pixels(canvas.screenshot()) - in_slices).max(axis=2)
        assert (apart > 8).mean() < 0.002  # of points at one depth the last one is seen


@pytest.mark.parametrize(("bearing", "side"), [(60.0, "left"), (-70.0, "right")])
@pytest.mark.quick_cases(1)
def test_the_page_points_to_the_nearest_hole(bearing: float, side: str) -> None:
    dive = KnownDive(per_scan=50)
    T = dive.pose(0)
    toward = T.rotation * Rotation.from_euler("z", bearing, degrees=True)
    near, far = (T.translation + toward.apply([away, 0.0, 0.0]) for away in (12.0, 24.0))
    x, y = np.meshgrid(*[np.arange(-30, 30, 0.5) + 0.25] * 2)
    cells = np.column_stack([x.ravel(), y.ravel()])
    seen = cells[(np.hypot(*(cells - near[:2]).T) > 1.2) & (np.hypot(*(cells - far[:2]).T) > 2.0)]
    with LivePage() as live, opened(live) as shown:
        publish(live, dive, 1)
        live.publish(coverage([np.repeat(seen, 2, axis=0)], 0.5, 0))
        wait_until(shown.page, "!document.querySelector('#hole').hidden")
        said = re.fullmatch(r"hole (\d+)\u202fm, (\d+)°\u202f(left|right)", shown.page.inner_text("#hole output"))
        assert said is not None
        assert abs(int(said[1]) - 12) <= 1
        assert abs(int(said[2]) - abs(bearing)) <= 4
        assert said[3] == side
        turn = float(shown.page.evaluate("parseFloat(document.querySelector('#hole span').style.rotate)"))
        assert abs(turn + bearing) <= 4  # clockwise from ahead


@pytest.mark.parametrize("bind", ["127.0.0.1", "0.0.0.0"])
@pytest.mark.quick_cases(1)
def test_the_page_becomes_the_report(content: Content, bind: str) -> None:
    dive = KnownDive(per_scan=50)
    with LivePage(bind) as live, opened(live) as shown:
        page = shown.page
        publish(live, dive, 3)
        live.making("mapping: 2 of 3")
        wait_until(page, "document.querySelector('#link').innerText.includes('mapping: 2 of 3')")
        live.show_report(report_text(content))
        page.wait_for_url("**/report*")
        wait_until(page, "window.sonarmap?.view?.frames > 0 && sonarmap.content")
        live.__exit__()
        page.click("text=Measure a distance")
        assert "Click on the first point" in page.inner_text("#picked")


def test_a_click_chooses_a_remedy() -> None:
    remedies = ("Use --exclude-box 0.7,-0.4,-0.3,1.2,0.4,0.1", "Do not use --frame frd any more")
    with LivePage() as live, opened(live) as shown:
        live.choices = frozenset(remedies)
        live.publish(("state", State("placed", alerts=("an object stands still",), choices=remedies).message))
        shown.page.click(f"text={remedies[0]}")
        wait_until(shown.page, "document.querySelector('#concerns').children.length === 3")
        for _ in range(50):
            if live.chosen:
                break
            shown.page.wait_for_timeout(100)
        assert list(live.chosen) == [remedies[0]]
        live.publish(("state", State("placed").message))
        wait_until(shown.page, "document.querySelector('#concerns').children.length === 0")


COUNTED = """
window.tones = 0;
const { start } = OscillatorNode.prototype;
OscillatorNode.prototype.start = function () { window.tones++; start.call(this); };
"""


def test_a_lost_vehicle_sounds_once_the_page_was_clicked_on() -> None:
    dive = KnownDive(per_scan=50)
    with LivePage() as live, browsed(live.address, "window.sonarmap", (800, 700), SOFTWARE, COUNTED) as shown:
        page = shown.page
        publish(live, dive, 3)
        live.publish(dive.state(2, lost=5.0))
        wait_until(page, "document.querySelector('#facts').textContent.includes('LOST for0:05')")
        page.click("#side")  # though Playwright's own questions count as clicks, too
        wait_until(page, "window.tones > 1")
        page.click("#sound")
        heard = page.evaluate("window.tones")
        page.wait_for_timeout(2000)
        assert page.evaluate("window.tones") == heard
        page.click("#sound")
        live.publish(dive.state(2))
        wait_until(page, "document.body.dataset.status === 'placed'")
        assert shown.console == []


@pytest.mark.slow
def test_the_camera_turns_with_the_vehicle_until_the_user_moves_it() -> None:
    heading = "(Math.PI / 180) * 70"  # of the known dive, clockwise from y
    with LivePage() as live, opened(live) as shown:
        page = shown.page
        publish(live, KnownDive(per_scan=300), 8)
        wait_until(page, f"Math.abs(sonarmap.view.camera.azimuth - {heading}) < 0.01 && !sonarmap.view.waiting")
        reach = page.evaluate("sonarmap.view.field.far / sonarmap.view.camera.pixel() / sonarmap.view.camera.height")
        assert 0.4 < reach < 1.2
        page.focus("#canvas")
        for name in ("distance", "age", "uncertainty", "height"):
            page.keyboard.press("c")
            assert page.input_value("#colored") == name
        assert page.get_attribute("#follow", "aria-pressed") == "true"
        page.keyboard.press("ArrowLeft")
        assert page.get_attribute("#follow", "aria-pressed") == "false"
        page.keyboard.press("f")
        assert page.get_attribute("#follow", "aria-pressed") == "true"
