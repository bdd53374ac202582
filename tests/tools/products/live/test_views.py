"""The default view of the live page in dives through known scenes. Its pictures are kept as pages/*.png under pytest's
temporary folder, to be looked at."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sonarmap.slam.live.growing import Pose
from sonarmap.slam.map.cell import cell_means
from sonarmap.tools.command.live.mapping import _thinned, _without_strays
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import Message, State, coverage
from sonarmap.tools.products.live.server import LivePage
from tests.tools.products.report.browser import SOFTWARE, browsed, wait_until

SCANS = 60
SIZES = ((1400, 900), (1024, 768), (390, 844))  # of a laptop, a tablet and a phone [pixels]
SHARES = (0.25, 0.5, 1.0)  # of a dive
COVARIANCE = np.diag([0.0, 0.0, 0.0, 0.01, 0.0036, 0.0016])


@cache
def simulated(scene: str) -> Simulation:
    return simulate(replace(plan(scene, seed=1), count=SCANS))


@dataclass(frozen=True)
class TrueDive:
    """A dive whose key scans are all at their true poses."""

    simulation: Simulation
    count: int  # of key scans

    def messages(self) -> Iterator[Message]:
        voxel = self.simulation.settings.sensor.max_range / 120
        poses = [Pose(0, T, COVARIANCE) for T in self.simulation.truth.T_world_sensor[: self.count]]
        scans = [scan.points for scan in self.simulation.scans[: self.count]]
        yield messages.RESET
        yield from messages.poses(0, poses)
        for key, points in enumerate(scans):
            yield messages.cloud(key, _thinned(_without_strays(cell_means(points, voxel)), 4000))
        yield messages.last(self.count - 1, _thinned(scans[-1], 2500))
        seen = [pose.T_part_sensor.apply(_thinned(points, 1000)) for pose, points in zip(poses, scans, strict=True)]
        yield coverage([points[:, :2] for points in seen], 4 * voxel, 0)
        state = State(
            "placed", self.count, self.count, self.count, parts=1, pose=messages.seven(poses[-1].T_part_sensor)
        )
        figures = {"held": 192.0, "depth": 7.3, "speed": 0.43, "heading": 213.0, "altitude": 4.21, "ahead": 12.6}
        half_axes = np.diag([0.1, 0.06, 0.04]).tolist()
        yield "state", replace(state, sigma=0.1, half_axes=half_axes, north=True, **figures).message


LOOK = """() => {
    const { view } = sonarmap, { gl } = view.scene, { camera, field } = view, { vehicle } = view.seen();
    view.budget = Infinity;
    view.draw(performance.now());
    const pixels = new Uint8Array(4 * gl.canvas.width * gl.canvas.height), ground = view.ground();
    gl.readPixels(0, 0, gl.canvas.width, gl.canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let drawn = 0;
    for (let k = 0; k < pixels.length; k += 4)
        drawn += ground.some((value, c) => Math.abs(255 * value - pixels[k + c]) > 2);
    const [x, y] = camera.project(vehicle.place), high = camera.height * camera.pixel();
    return [drawn / (pixels.length / 4), x / camera.width, y / camera.height, field.far / high];
}"""


@pytest.mark.parametrize("scene", ["ship", "harbor", "floodgate", "pool"])
@pytest.mark.slow
def test_the_default_view_shows_the_place(scene: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp() / "pages"
    folder.mkdir(exist_ok=True)
    with LivePage() as live:
        for share in SHARES:
            dive = TrueDive(simulated(scene), round(share * SCANS))
            for message in dive.messages():
                live.publish(message)
            for size in SIZES:
                look(live, dive.count, size, folder / f"{scene}_{100 * share:.0f}_{size[0]}.png")


def look(live: LivePage, count: int, size: tuple[int, int], picture: Path) -> None:
    """Keep a picture of the page, and check what fills it."""
    with browsed(live.address, "window.sonarmap && sonarmap.wire.open", size, SOFTWARE) as shown:
        wait_until(shown.page, f"sonarmap.dive.state.keys === {count} && sonarmap.dive.clouds.size === {count}")
        wait_until(shown.page, "sonarmap.dive.last && sonarmap.view.frames && !sonarmap.view.waiting")
        drawn, x, y, reach = shown.page.evaluate(LOOK)
        shown.page.screenshot(path=picture)
        assert drawn > 0.1, picture  # a quarter of a dive shows a fifth of the view, an empty page nothing
        assert 0.2 < x < 0.8
        assert 0.4 < y < 1.0
        assert 0.4 < reach < 1.2  # the last scan's range and the height of the picture
        assert shown.console == []
