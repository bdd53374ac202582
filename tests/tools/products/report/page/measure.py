"""How a report opens, turns and measures in Chromium: `python -m tests.tools.products.report.page.measure OUT [PNG]`.

WebGL runs on the processor unless CHROMIUM_FLAGS says otherwise, such as `--use-angle=gl-egl --ignore-gpu-blocklist`.
"""

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.map_folder.names import REPORT
from tests.tools.products.report.page.browser import SOFTWARE, Opened, click, opened

FIRST_FRAME = "performance.getEntriesByName('opened')[0].startTime / 1000"
TURN = """async seconds => {
    const { view } = sonarmap;
    const begin = performance.now(), frames = view.frames;
    while (performance.now() - begin < 1000 * seconds) {
        view.camera.turn(0.02, 0);
        view.request(true);
        await new Promise(requestAnimationFrame);
        view.scene.gl.readPixels(0, 0, 1, 1, view.scene.gl.RGBA, view.scene.gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    return [(view.frames - frames) / ((performance.now() - begin) / 1000), view.points.count > 30000 ? view.step : 1];
}"""
LOOK_AT = """place => {
    const { view } = sonarmap;
    view.camera.lookAt(place, 60 * view.part.voxel);
    view.request();
}"""
RENDERER = """() => {
    const { gl } = sonarmap.view.scene;
    return gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
}"""


def measured(out: Path, picture: Path | None = None) -> dict[str, Any]:
    """What comes of opening, turning and measuring, by name with its unit."""
    folder = read_map_folder(out)
    points = folder.parts[0].points
    flags = tuple(os.environ.get("CHROMIUM_FLAGS", "").split()) or SOFTWARE
    begin = time.perf_counter()
    with opened(out / REPORT, flags, silent=False) as shown:
        page = shown.page
        row: dict[str, Any] = {
            "points": len(points),
            "bytes": (out / REPORT).stat().st_size,
            "start of the browser and opening [s]": time.perf_counter() - begin,
            "from navigation to the first frame [s]": page.evaluate(FIRST_FRAME),
        }
        if picture is not None:
            page.wait_for_timeout(500)
            page.screenshot(path=picture)
        row["frames/s while turning"], row["one of so many points drawn then"] = page.evaluate(TURN, 4)
        page.wait_for_timeout(1000)
        row |= _distance(shown, points) | {"renderer": page.evaluate(RENDERER), "console": shown.said}
        row["quantum [m]"] = page.evaluate("sonarmap.view.points.quantum")
    return row


def _distance(shown: Opened, points: np.ndarray) -> dict[str, Any]:
    """Two points that lie uppermost are clicked on from above, and their distance is compared with map.ply's."""
    page = shown.page
    page.evaluate("sonarmap.view.camera.reset(); sonarmap.view.camera.fromAbove(); scrollTo(0, 0)")
    a, b = _uppermost(points, page.evaluate("sonarmap.view.part.voxel"))
    page.locator("#measure").click()
    for place in (a, b):
        page.evaluate(LOOK_AT, place.tolist())
        click(page, place)
    found = np.array(page.evaluate("sonarmap.view.measured"))
    read = page.locator("#picked dd").first.inner_text()
    return {
        "largest difference of a coordinate from map.ply [m]": float(np.abs(found - [a, b]).max()),
        "distance in map.ply [m]": float(np.linalg.norm(b - a)),
        "distance in the page [m]": float(np.linalg.norm(found[1] - found[0])),
        "distance as the page says it": read,
    }


def _uppermost(points: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """Two points far apart, over which no other lies within two voxels."""
    some = np.random.default_rng(1).choice(points, min(len(points), 3000), replace=False)
    tree = KDTree(points[:, :2])
    near = tree.query_ball_point(some[:, :2], 2 * voxel)
    tops = np.array([point for point, over in zip(some, near, strict=True) if points[over, 2].max() <= point[2]])
    return tops[0], tops[np.linalg.norm(tops - tops[0], axis=1).argmax()]


if __name__ == "__main__":
    for name, value in measured(Path(sys.argv[1]), *map(Path, sys.argv[2:3])).items():
        print(f"{name}: {value:.6g}" if isinstance(value, float) else f"{name}: {value}")
