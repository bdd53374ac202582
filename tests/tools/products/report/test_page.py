"""The page's file, and pages of damaged, hostile and divided maps in Chromium."""

import json
import re
from base64 import b64decode, b64encode
from dataclasses import replace
from hashlib import sha256
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, REPORT
from sonarmap.tools.files.readers.csv_table import SUMMARY
from sonarmap.tools.products.report.content import Content, content_of
from sonarmap.tools.products.report.page import SCRIPTS, report_text, write_report
from tests.samples.places import ROOT
from tests.tools.products.export.finished import finished_map
from tests.tools.products.report.browser import WITHOUT_WEBGL, opened, wait_until
from tests.tools.products.report.known_map import DOT, folder_of, known_points, written

WEB, LIVE = (ROOT / "tools" / "products" / folder for folder in ("report/web", "live"))


def test_the_policy_allows_only_the_embedded_script_and_style(content: Content) -> None:
    text = report_text(content)
    for tag, policy in (("style", "style-src"), ('script type="module"', "script-src")):
        (inside,) = re.findall(rf"<{tag}>(.*?)</{tag.split()[0]}>", text, re.DOTALL)
        digest = b64encode(sha256(inside.encode()).digest()).decode()
        assert f"{policy} 'sha256-{digest}'" in text
    assert "default-src 'none'" in text
    addresses = set(re.findall(r"(?:https?|ftp|wss?):?//[^\s\"'`)]+", text))
    assert addresses == {"http://www.w3.org/2000/svg"}  # an XML namespace, never fetched


def test_embedded_content_and_points_are_read_back(content: Content) -> None:
    names = ["<b>&amp;", "</script>", "深 \udcff", "\u2028"]
    text = report_text(replace(content, shown=content.shown | {"names": names, "title": "</title><b>\udcff"}))
    assert text.count("<b>") == 0
    (embedded,) = re.findall(r'<script type="application/json" id="content-json">(.*?)</script>', text)
    assert json.loads(embedded)["names"] == names
    (points,) = re.findall(r'<script type="application/gzip" id="points-0">(.*?)</script>', text)
    assert b64decode(points) == content.points[0]
    assert unescape(re.findall("<title>(.*)</title>", text)[0]) == r"</title><b>\udcff"


def test_scripts_never_turn_text_into_markup() -> None:
    assert {path.relative_to(WEB).as_posix() for path in WEB.rglob("*.js")} == set(SCRIPTS)
    for path in (*WEB.rglob("*.js"), *LIVE.glob("*.js")):
        script = path.read_text()
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", script)


def test_the_page_is_listed_and_removed_by_the_next_map(tmp_path: Path) -> None:
    out = finished_map(tmp_path)
    before = json.loads((out / SUMMARY).read_text())
    for _ in range(2):
        assert write_report(read_map_folder(out)) == out / REPORT
        after = json.loads((out / SUMMARY).read_text())
        assert after == before | {"files": [*before["files"], REPORT]}
    finished_map(out)
    assert not (out / REPORT).exists()
    assert REPORT not in json.loads((out / SUMMARY).read_text())["files"]
    (out / "holiday.png").write_bytes(DOT)  # pictures that the map does not list stay out
    write_report(read_map_folder(out))
    assert "holiday" not in (out / REPORT).read_text()


DECIDED = {
    "ties": [{"target": "scan0", "source": "scan5", "verdict": "add", "note": "", "effect": "", "x_m": 1.5}],
    "control_points": [
        {"name": "pile", "scan": "scan3", "use": "control", "in_sigmas": 1.5}
        | {key: [1.0, 2.0, 3.0] for key in ("point", "known", "estimated", "sigma")}
    ],
    "control": {"left_out": [{"name": "pile", "scan": "scan3", "sigmas": 5.0}]},
}
SPOILED: tuple[Any, ...] = (None, -1, 1e400, "x", [], {}, True, [None], "</script>")


def spoil(value: Any, rng: np.random.Generator) -> None:
    """Replace or delete one random value of a JSON document, in place."""
    while True:
        keys = list(value) if isinstance(value, dict) else range(len(value))
        key = keys[rng.integers(len(keys))]
        inside = value[key]
        if isinstance(inside, dict | list) and inside and rng.random() < 0.75:
            value = inside
        elif rng.random() < 0.2:
            del value[key]
            return
        else:
            value[key] = SPOILED[rng.integers(len(SPOILED))]
            return


@pytest.mark.parametrize("seed", [pytest.param(1, id="quick"), pytest.param(2, id="slow", marks=pytest.mark.slow)])
def test_a_damaged_folder_gives_a_page_or_an_error_that_names_the_file(tmp_path: Path, seed: int) -> None:
    """Random values of summary.json and graph.json are replaced or deleted."""
    out = finished_map(tmp_path / "out")
    whole = {name: json.loads((out / name).read_text()) for name in (SUMMARY, FULL_GRAPH)}
    whole[SUMMARY] |= DECIDED | {"checksums": {}}  # checksums would refuse any damage of graph.json
    rng = np.random.default_rng(seed)
    outcomes = {"page": 0, "error": 0}
    messages: set[str] = set()
    for _ in range(30 if seed == 1 else 600):
        name = (SUMMARY, FULL_GRAPH)[rng.integers(2)]
        damaged = json.loads(json.dumps(whole[name]))
        spoil(damaged, rng)
        for each, content in whole.items():
            (out / each).write_text(json.dumps(damaged if each == name else content))
        try:
            page = write_report(read_map_folder(out)).read_text(encoding="utf-8")
            assert page.count("</script>") == 4
            outcomes["page"] += 1
        except InputError as error:
            messages.add(str(error).split("(")[0])
            outcomes["error"] += 1
    assert min(outcomes.values()) > 3, outcomes
    assert not [words for words in messages if str(out) not in words and "origin" not in words]


HOSTILE = (
    "</script><script>window.hurt=1</script>",
    "<img src=x onerror=window.hurt=1>",
    "`${window.hurt=1}`&lt;\udcff",
)


def test_without_webgl_the_page_shows_pictures_and_a_notice(content: Content, tmp_path: Path) -> None:
    with opened(written(content, tmp_path / "report.html"), WITHOUT_WEBGL) as plain:
        assert re.search("cannot be shown.*pictures", plain.page.locator("#map .notice").inner_text())
        assert plain.page.locator("#map img").count() == 2
        assert plain.page.evaluate("[...document.images].every(image => image.naturalWidth === 1)")
        assert plain.page.locator("#loops .link").count() > 0  # the rest of the page is shown
        plain.page.locator("#loops .link").first.click()


def test_texts_from_files_are_never_markup(tmp_path: Path) -> None:
    """Hostile names of scans and files, settings and reasons are shown as they are, and never run."""
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
        page.page.locator("#controls select").first.select_option("seen")
        page.page.locator("details summary").click()
        assert page.page.evaluate("window.hurt") is None
        assert page.page.locator("img").count() == 1
        assert page.page.locator("script").count() == 4  # content, pictures, points, and the page's own
        assert "<img src=x onerror=window.hurt=1>" in page.page.locator("#picked").inner_text()
        assert "</script><script>" in page.page.locator("#settings").inner_text()


@pytest.mark.slow
def test_parts_are_shown_one_at_a_time(tmp_path: Path) -> None:
    folder = read_map_folder(finished_map(tmp_path / "out", split=True))
    assert [len(part.scans) for part in folder.parts] == [5, 3]
    with opened(written(content_of(folder), tmp_path / "parts.html")) as parts:
        counts = [len(part.points) for part in folder.parts]
        assert parts.page.evaluate("sonarmap.view.points.count") == counts[0]
        parts.page.locator("#controls select").first.select_option("1")
        wait_until(parts.page, f"sonarmap.view.points.count === {counts[1]}")
        assert "2 separate parts" in parts.page.locator("#concerns").inner_text()
