"""How fast the live page draws 0.2, 1 and 2 million points on the processor (SwiftShader), and its memory; `pytest -s`
shows the figures."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.live.growing import Pose
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import Message, State
from sonarmap.tools.products.live.server import LivePage
from tests.tools.products.report.browser import SOFTWARE, browsed, started, wait_until

EACH = 4000  # points of a key scan
RATE = 5.0  # scans [1/s]
SECONDS = 5.0  # of a measurement
WANTED = 10.0  # frames [1/s] with nothing else to do; half of that passes here, as other work may run beside the tests


class Circle:
    """A dive around a circle of 30 m, and its messages."""

    def __init__(self, keys: int) -> None:
        self.keys, rng = keys, np.random.default_rng(0)
        self.points = rng.uniform([1, -10, -6], [20, 10, -5.8], (EACH, 3))
        self.points[: EACH // 4, 1] = 10.0
        self.points[: EACH // 4, 2] = rng.uniform(-6, 2, EACH // 4)

    def pose(self, turn: float) -> RigidTransform:
        place = [30 * np.cos(turn), 30 * np.sin(turn), 0.0]
        return RigidTransform.from_components(place, Rotation.from_euler("z", turn + np.pi / 2))

    def begun(self) -> Iterator[Message]:
        turns = np.linspace(0, 2 * np.pi, self.keys, endpoint=False)
        yield from messages.poses(0, [Pose(0, self.pose(turn), np.eye(6) * 1e-4) for turn in turns])
        for key in range(self.keys):
            yield messages.cloud(key, self.points)
        yield from self.scan(0)

    def scan(self, number: int) -> Iterator[Message]:
        """The last scan, at half a meter a second, and a state whose stamp is the time of now."""
        pose = self.pose(number * 0.5 / RATE / 30)
        yield messages.last(0, self.pose(0).inv().apply(pose.apply(self.points[:2500])))
        state = State("placed", number, number, self.keys, parts=1, stamp=time.time(), pose=messages.seven(pose))
        half_axes = np.diag([0.1, 0.1, 0.1]).tolist()
        yield "state", replace(state, half_axes=half_axes, depth=3.0, speed=0.5, heading=float(number % 360)).message


@contextmanager
def scans_coming(live: LivePage, dive: Circle) -> Iterator[None]:
    ended = Event()

    def send() -> None:
        number = 0
        while not ended.wait(1 / RATE):
            number += 1
            for message in dive.scan(number):
                live.publish(message)

    thread = Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


MOVED = """async (seconds) => {
    const { view } = sonarmap, { gl } = view.scene, begin = performance.now(), before = view.frames;
    while (performance.now() - begin < 1000 * seconds) {
        view.camera.turn(0.01, 0);
        view.request(true);
        await new Promise(requestAnimationFrame);
    }
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // all of it is drawn
    return (1000 * (view.frames - before)) / (performance.now() - begin);
}"""

WATCHED = """async (seconds) => {
    const { view, dive } = sonarmap, begin = performance.now(), before = view.frames, delays = [];
    for (let [shown, came, frames] = [dive.state.stamp, null, 0]; performance.now() - begin < 1000 * seconds; ) {
        await new Promise(requestAnimationFrame);
        if (came && view.frames > frames) {
            delays.push(Date.now() / 1000 - came);
            [shown, came] = [came, null];
        }
        if (!came && shown !== dive.state.stamp) [came, frames] = [dive.state.stamp, view.frames];
    }
    delays.sort((a, b) => a - b);
    return [(1000 * (view.frames - before)) / (performance.now() - begin), delays[delays.length >> 1]];
}"""

RESTED = """async () => {
    const { view } = sonarmap, begin = performance.now(), { show } = view.scene;
    const whole = new Promise((shown) => (view.scene.show = function (camera, look) {
        show.call(this, camera, look);
        if (!look.alone) shown(performance.now() - begin);
    }));
    view.request();
    const took = view.budget < Infinity ? await whole : 0, frames = view.frames;
    delete view.scene.show;
    await new Promise((over) => setTimeout(over, 1000));
    return [took, view.frames - frames];
}"""


def memory() -> float:
    """Memory of the browser's page and graphics processes [MB]."""
    session = started(SOFTWARE).new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    of_page = [row["id"] for row in processes if row["type"] in ("renderer", "GPU")]
    pages = sum(int(Path(f"/proc/{number}/statm").read_text().split()[1]) for number in of_page)
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
@pytest.mark.parametrize("points", [200_000, 1_000_000, 2_000_000])
def test_the_page_draws_fluently(points: int) -> None:
    dive = Circle(points // EACH)
    with LivePage() as live:
        for message in dive.begun():
            live.publish(message)
        with browsed(live.address, "window.sonarmap && sonarmap.wire.open", (1400, 900), SOFTWARE) as shown:
            page = shown.page
            wait_until(page, f"sonarmap.dive.clouds.size === {dive.keys} && sonarmap.dive.last && sonarmap.view.frames")
            page.evaluate(MOVED, 2.0)  # until the number of points suits this machine
            moved = page.evaluate(MOVED, SECONDS)
            whole, after = page.evaluate(RESTED)
            page.evaluate("sonarmap.view.setFollow(true)")
            with scans_coming(live, dive):
                page.evaluate(WATCHED, 1.0)
                watched, delay = page.evaluate(WATCHED, SECONDS)
            heap = page.evaluate("performance.memory.usedJSHeapSize / 1e6")
            print(
                f"{points:,} points, load {os.getloadavg()[0]:.1f}: {moved:.1f} frames/s while turned, {watched:.1f} "
                f"while scans come at {RATE:.0f} Hz, drawn {delay:.2f} s after they are sent (median); all points "
                f"{whole / 1000:.1f} s after the last movement; {memory():.0f} MB in the browser, of it "
                f"{heap:.0f} MB of JavaScript's heap"
            )
            assert min(moved, watched) > WANTED / 2
            assert after == 0  # nothing is drawn while nothing changes
            assert shown.console == []
