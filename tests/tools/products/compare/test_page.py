"""changes.html: what the file holds, and the page in a real Chromium."""

import json
import re
from base64 import b64decode, b64encode
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.products.compare import page as page_module
from sonarmap.tools.products.compare.comparison import Comparison
from sonarmap.tools.products.compare.distances import Verdict, distances_between
from sonarmap.tools.products.compare.page import UNSAID, changes_page
from sonarmap.tools.products.compare.regions import regions_of
from sonarmap.tools.products.report.page.points import FRACTION
from tests.tools.products.compare.made_up import VOXEL, surveyed
from tests.tools.products.report.page.browser import WITHOUT_WEBGL, opened, wait_until
from tests.tools.products.report.page.known_map import DOT, unpack

HOSTILE = "/maps/</script><script>window.hurt=1</script><img src=x onerror=window.hurt=1>\udcff"
ALIGNMENT = np.diag(np.repeat([1e-3, 0.02], 3) ** 2)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    """A hole of 6 x 6 m, 0.8 m deep."""
    old, new = surveyed(1), surveyed(2, change=-0.8)
    distances = distances_between(old, new, ALIGNMENT, VOXEL, 4 * VOXEL, 2 * VOXEL)
    return Comparison("maps/old", HOSTILE, None, distances, tuple(regions_of(distances)), old.points, new.points)


@pytest.fixture(scope="module")
def path(comparison: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(comparison, tmp_path_factory.mktemp("page"))


def written(comparison: Comparison, folder: Path) -> Path:
    (folder / "changes.html").write_text(changes_page(comparison, DOT), encoding="utf-8")
    return folder / "changes.html"


def embedded(text: str) -> tuple[dict[str, object], dict[str, tuple[np.ndarray, dict[str, np.ndarray]]]]:
    """What the page says, and the points and columns of each cloud."""
    (json_text,) = re.findall(r'<script type="application/json" id="content-json">(.*?)</script>', text)
    content = json.loads(json_text)
    packed = re.findall(r'<script type="application/gzip" id="points-\d">(.*?)</script>', text)
    layouts = content["clouds"].items()
    return content, {
        name: unpack(b64decode(data), layout["packed"]) for (name, layout), data in zip(layouts, packed, strict=True)
    }


def test_only_what_the_policy_names_may_run_and_no_other_address_is_named(comparison: Comparison) -> None:
    text = changes_page(comparison, DOT)
    for tag, policy in (("style", "style-src"), ('script type="module"', "script-src")):
        (inside,) = re.findall(rf"<{tag}>(.*?)</{tag.split()[0]}>", text, re.DOTALL)
        assert f"{policy} 'sha256-{b64encode(sha256(inside.encode()).digest()).decode()}'" in text
    assert "default-src 'none'" in text
    assert set(re.findall(r"(?:https?|ftp|wss?):?//[^\s\"'`)]+", text)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text)


def test_what_is_embedded_comes_back(comparison: Comparison) -> None:
    text = changes_page(comparison, DOT)
    assert text.count("</script>") == 5  # content, three clouds and the page's own
    assert "<img src=x" not in text
    content, clouds = embedded(text)
    assert {name: content[name] for name in comparison.as_json} == json.loads(json.dumps(comparison.as_json))
    for name, points in (("old", comparison.old_points), ("new", comparison.new_points)):
        assert len(clouds[name][0]) == len(points)
        np.testing.assert_allclose(np.sort(clouds[name][0][:, 2]), np.sort(points[:, 2]), atol=VOXEL / FRACTION)
    codes, verdicts = clouds["changes"][1]["distance"], clouds["changes"][1]["verdict"]
    np.testing.assert_array_equal(np.sort(verdicts), np.sort(comparison.distances.verdict))
    np.testing.assert_array_equal(codes == UNSAID, verdicts >= Verdict.UNSURE)
    assert (codes[verdicts == Verdict.LOST] < 127).all()
    assert (codes[verdicts == Verdict.GAINED] > 127).all()


def test_a_region_is_marked_and_flown_to(path: Path, comparison: Comparison) -> None:
    with opened(path) as shown:
        page = shown.page
        (region,) = comparison.regions
        row = page.locator("#regions tbody tr")
        assert row.inner_text().split("\t")[1:3] == ["lost", f"{region.area:.1f}"]
        page.get_by_role("button", name="Changes").click()
        assert page.is_hidden("#wipe")
        assert "cannot be said" in page.inner_text("#legend")
        row.get_by_role("button").press("Enter")
        assert row.get_attribute("aria-current") == "true"
        x, y, z = region.place.tolist()
        away = f"sonarmap.view.camera.target.map((value, k) => Math.abs(value - [{x}, {y}, {z}][k]))"
        wait_until(page, f"Math.max(...{away}) < 1e-6")
        assert f"{region.volume:.1f}".replace("-", "−") in page.inner_text("#labels")
        texels = "new Set(sonarmap.view.scene.clouds.get('changes').points.places.filter((_, k) => k % 4 === 3)).size"
        every = page.evaluate(texels)
        page.locator("#beyond input").check()
        assert page.evaluate(texels) < every
        page.locator("#canvas").press("Escape")
        assert row.get_attribute("aria-current") == "false"


def test_texts_from_files_are_never_markup(path: Path) -> None:
    with opened(path) as shown:
        assert shown.page.evaluate("window.hurt") is None
        assert shown.page.locator("img").count() == 1
        assert "</script><script>window.hurt=1" in shown.page.inner_text("#facts")


@pytest.mark.slow
def test_the_table_and_the_picture_are_there_without_webgl(comparison: Comparison, tmp_path: Path) -> None:
    none = replace(comparison, regions=())
    with opened(written(comparison, tmp_path), WITHOUT_WEBGL) as shown:
        assert "cannot be shown in 3D" in shown.page.inner_text("#map .notice")
        assert shown.page.locator("#regions tbody tr").count() == 1
        assert shown.page.evaluate("document.images[0].naturalWidth") == 1
        shown.page.locator("#regions tbody tr button").click()
    with opened(written(none, tmp_path)) as shown:
        assert "No change is beyond its error" in shown.page.inner_text("#regions")


def test_of_many_points_some_are_shown(comparison: Comparison, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_module, "MOST_POINTS", 500)
    text = changes_page(comparison, DOT)
    assert text == changes_page(comparison, DOT)  # the same at random
    content, clouds = embedded(text)
    assert [len(points) for points, _ in clouds.values()] == [500] * 3
    assert content["clouds"]["old"]["all"] == len(comparison.old_points)  # type: ignore[index]


@pytest.mark.slow
def test_the_surveys_are_wiped_by_mouse_and_keyboard(path: Path) -> None:
    """Left of the line is what the old survey alone shows there, right of it what the new one does."""
    pixels = """(percent) => {
        const { view } = sonarmap, { gl } = view.scene, { width, height } = gl.canvas;
        view.wipe(percent);
        view.draw();
        const all = new Uint8Array(4 * width * height), half = width >> 1;
        gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, all);
        return [0, half].map((from) => {
            let sum = 0;
            for (let k = 0; k < all.length; k++) {
                const x = (k >> 2) % width;
                if (x >= from && x < from + half) sum = (31 * sum + all[k]) % 1000003;
            }
            return sum;
        });
    }"""
    with opened(path, silent=False) as shown:
        page = shown.page
        old, new, both = (page.evaluate(pixels, percent) for percent in (100, 0, 50))
        assert both == [old[0], new[1]]
        assert old[0] != new[0]
        page.locator("#wipe").focus()
        page.keyboard.press("ArrowLeft")
        assert page.evaluate("[sonarmap.view.scene.wipe, sonarmap.view.mode]") == [0.49, "both"]
        line = page.locator("#line").bounding_box()
        handle = page.locator("#wipe").bounding_box()
        assert line
        assert handle
        y = handle["y"] + handle["height"] / 2
        page.mouse.move(line["x"], y)
        page.mouse.down()
        page.mouse.move(line["x"] + 100, y, steps=3)
        page.mouse.up()
        moved = page.locator("#line").bounding_box()
        assert moved
        assert moved["x"] == pytest.approx(line["x"] + 100, abs=3)
        page.mouse.move(line["x"] - 100, y)  # beside the handle the map is turned
        before = page.evaluate("sonarmap.view.camera.azimuth")
        page.mouse.down()
        page.mouse.move(line["x"] - 150, y, steps=3)
        page.mouse.up()
        assert page.evaluate("sonarmap.view.camera.azimuth") != before
        assert all("ReadPixels" in words for words in shown.said)  # that it is slow
        assert all(address.startswith(("file:", "data:")) for address in shown.asked)
