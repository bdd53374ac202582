"""Pages of many kinds in a real Chromium: large, without WebGL, damaged, hostile, dark, of several parts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.products.report.page.content import Content, content_of
from sonarmap.tools.products.report.page.page import report_text
from tests.tools.products.export.finished import finished_map
from tests.tools.products.report.page.browser import WITHOUT_WEBGL, click, opened, wait_until
from tests.tools.products.report.page.known_map import DOT, folder_of, known_points, written

HOSTILE = (
    "</script><script>window.hurt=1</script>",
    "<img src=x onerror=window.hurt=1>",
    "`${window.hurt=1}`&lt;\udcff",
)


@pytest.mark.slow
def test_a_third_is_drawn_while_moving(content: Content, tmp_path: Path) -> None:
    points = np.random.default_rng(2).uniform(-40, 40, (120_001, 3))
    path = written(content_of(folder_of(points, tmp_path / "out")), tmp_path / "many.html")
    counting = """
        const draw = WebGL2RenderingContext.prototype.drawArrays;
        WebGL2RenderingContext.prototype.drawArrays = function (mode, first, count) {
            if (mode === this.POINTS) (window.drawn ??= []).push(count);
            return draw.call(this, mode, first, count);
        };"""
    with opened(path, script=counting) as many:
        assert many.page.evaluate("drawn[drawn.length - 1]") == 120_001
        many.page.locator("#canvas").focus()
        many.page.keyboard.press("ArrowLeft")
        wait_until(many.page, "drawn.length >= 3 && drawn[drawn.length - 1] === 120001")  # once it stands still
        assert 40_001 in many.page.evaluate("drawn")


def test_pictures_and_a_sentence_without_webgl(content: Content, tmp_path: Path) -> None:
    with opened(written(content, tmp_path / "report.html"), WITHOUT_WEBGL) as plain:
        sentence = plain.page.locator("#map .notice").inner_text()
        assert "cannot be shown" in sentence
        assert "pictures" in sentence
        assert plain.page.locator("#map img").count() == 2
        assert plain.page.evaluate("[...document.images].every(image => image.naturalWidth === 1)")
        assert plain.page.locator("#loops .link").count() > 0  # the rest is there
        plain.page.locator("#loops .link").first.click()


@pytest.mark.slow
def test_pictures_where_the_points_are_damaged(content: Content, tmp_path: Path) -> None:
    for k, spoiled in enumerate((content.points[0][:40], b"", bytes(64))):
        path = written(replace(content, points=(spoiled,)), tmp_path / f"{k}.html")
        with opened(path) as damaged:
            assert "cannot be unpacked" in damaged.page.locator("#map .notice").inner_text()
            assert damaged.page.locator("#map img").count() == 2


def test_texts_from_files_are_never_markup(tmp_path: Path) -> None:
    """Names of scans, of files and reasons may hold anything: they are shown as they are, and nothing of them runs."""
    folder = folder_of(known_points(), tmp_path / "out")
    names = tuple(HOSTILE[k % 3] + str(k) for k in range(8))
    graph = dict(folder.graph) | {"pairs": [pair | {"reason": HOSTILE[1]} for pair in folder.graph["pairs"]]}
    summary = dict(folder.summary) | {
        "settings": {HOSTILE[0]: HOSTILE[1], "inputs": list(HOSTILE)},
        "inputs": [{"name": name, "bytes": 3, "sha256": HOSTILE[1]} for name in HOSTILE],
        "device": {"name": HOSTILE[0], "platform": HOSTILE[1]},
        "unread": [{"name": name} for name in HOSTILE],
    }
    hostile = content_of(replace(folder, names=names, graph=graph, summary=summary))
    pictures = {HOSTILE[1]: DOT}
    with opened(written(replace(hostile, pictures=pictures), tmp_path / "hostile.html")) as page:
        page.page.locator("#loops .link").first.click()
        page.page.locator("#controls select").first.select_option("scan")
        page.page.locator("details summary").click()
        assert page.page.evaluate("window.hurt") is None
        assert page.page.locator("img").count() == 1
        assert page.page.locator("script").count() == 4  # content, pictures, points, and the page's own
        assert "<img src=x onerror=window.hurt=1>" in page.page.locator("#picked").inner_text()
        assert "</script><script>" in page.page.locator("#settings").inner_text()


def test_a_script_that_is_not_the_pages_own_does_not_run(content: Content, tmp_path: Path) -> None:
    """Even one that got in."""
    text = report_text(content).replace("<header>", "<script>window.hurt = 1</script><header>")
    (tmp_path / "injected.html").write_text(text, encoding="utf-8")
    path = tmp_path / "injected.html"
    with opened(path, silent=False) as injected:
        assert injected.page.evaluate("window.hurt") is None
        assert any("Content Security Policy" in said for said in injected.said)


def test_a_crossing_is_shown_with_its_distances(content: Content, tmp_path: Path) -> None:
    near = {"target": 0, "source": 5, "before_m": 0.52, "before_90_m": 1.1, "after_m": 0.071, "after_90_m": 0.2}
    far = near | {"target": 1, "source": 6, "after_m": 0.31}
    crossings = {"pairs": 2, "before": 0.52, "before_90": 1.1, "after": 0.19, "after_90": 0.2, "rows": [near, far]}
    shown = content.shown | {"crossings": crossings}
    with opened(written(replace(content, shown=shown), tmp_path / "crossings.html")) as page:
        row = page.page.locator("#crossings .link").first
        assert row.inner_text() == "scan1\u00a0– scan6"  # the one that is farther apart comes first
        row.click()
        assert "0.31\u202fm apart" in page.page.locator("#picked").inner_text()


def test_dark_and_light(content: Content, tmp_path: Path) -> None:
    with opened(written(content, tmp_path / "report.html"), color_scheme="dark") as dark:
        ground = "getComputedStyle(document.body).backgroundColor"
        assert dark.page.evaluate(ground) == "rgb(17, 22, 27)"
        dark.page.locator("#theme").click()
        assert dark.page.evaluate(ground) == "rgb(255, 255, 255)"
        dark.page.locator("#theme").click()
        assert dark.page.evaluate(ground) == "rgb(17, 22, 27)"


def test_parts_are_shown_one_at_a_time(tmp_path: Path) -> None:
    folder = read_map_folder(finished_map(tmp_path / "out", split=True))
    assert [len(part.scans) for part in folder.parts] == [5, 3]
    with opened(written(content_of(folder), tmp_path / "parts.html")) as parts:
        counts = [len(part.points) for part in folder.parts]
        assert parts.page.evaluate("sonarmap.view.points.count") == counts[0]
        parts.page.locator("#controls select").first.select_option("1")
        wait_until(parts.page, f"sonarmap.view.points.count === {counts[1]}")
        assert "2 separate maps" in parts.page.locator("#concerns").inner_text()


@pytest.mark.slow
def test_scans_of_two_parts_are_tied(tmp_path: Path) -> None:
    """A pose is picked in a part, and the other in the next; a line could not be drawn between their frames."""
    folder = read_map_folder(finished_map(tmp_path / "out", split=True))
    content = content_of(folder)
    content = replace(content, shown=content.shown | {"pairs": [], "sequential": []})
    with opened(written(content, tmp_path / "parts.html")) as parts:
        for number, place in ((0, 1), (1, 2)):
            if number:
                parts.page.locator("#controls select").first.select_option("1")
                wait_until(parts.page, f"sonarmap.view.part === sonarmap.content.parts[{number}]")
            parts.page.evaluate("sonarmap.view.camera.fromAbove()")
            pose = parts.page.evaluate(f"sonarmap.view.part.track.places[{place}]")
            click(parts.page, pose)
            if not number:
                parts.page.get_by_role("button", name="Tie to another scan").click()
        assert "scan1 and scan7" in parts.page.locator("#picked").inner_text()
        parts.page.locator("#picked").get_by_role("button", name="add").click()
        expected = [{"target": "scan1", "source": "scan7", "verdict": "add", "note": ""}]
        assert parts.page.evaluate("sonarmap.decisions.ties") == expected
        assert parts.page.evaluate("sonarmap.view.scene.lines.get('accepted').count") == 0


@pytest.mark.slow
def test_a_track_of_one_pose(tmp_path: Path) -> None:
    folder = folder_of(known_points(), tmp_path / "out")
    part = folder.parts[0]
    lone = Trajectory(part.trajectory.stamps[:1], part.trajectory.T_world_sensor[:1])
    columns = dict(part.columns) | {"scan": np.zeros(len(part.points), np.int64)}
    part = replace(part, scans=(0,), trajectory=lone, covariances=part.covariances[:1], columns=columns)
    with opened(written(content_of(replace(folder, parts=(part,))), tmp_path / "one.html")):
        pass  # it is drawn, and nothing is said
