"""The page's text: one file that needs no other, and refuses what is no map."""

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
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, REPORT, SUMMARY
from sonarmap.tools.products.report.page.content import Content
from sonarmap.tools.products.report.page.page import SCRIPTS, report_text, write_report
from tests.samples.places import ROOT
from tests.tools.products.export.finished import finished_map
from tests.tools.products.report.page.known_map import DOT

WEB = ROOT / "tools" / "products" / "report" / "page" / "web"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_map(tmp_path_factory.mktemp("finished"))


def test_only_what_the_policy_names_may_run(content: Content) -> None:
    text = report_text(content)
    for tag, policy in (("style", "style-src"), ('script type="module"', "script-src")):
        (inside,) = re.findall(rf"<{tag}>(.*?)</{tag.split()[0]}>", text, re.DOTALL)
        digest = b64encode(sha256(inside.encode()).digest()).decode()
        assert f"{policy} 'sha256-{digest}'" in text
    assert "default-src 'none'" in text


def test_it_names_no_other_address(content: Content) -> None:
    addresses = set(re.findall(r"(?:https?|ftp|wss?):?//[^\s\"'`)]+", report_text(content)))
    assert addresses == {"http://www.w3.org/2000/svg"}  # a name, which nothing fetches


def test_what_is_embedded_comes_back(content: Content) -> None:
    names = ["<b>&amp;", "</script>", "深 \udcff", "\u2028"]
    text = report_text(replace(content, shown=content.shown | {"names": names, "title": "</title><b>\udcff"}))
    assert text.count("<b>") == 0
    (embedded,) = re.findall(r'<script type="application/json" id="content-json">(.*?)</script>', text)
    assert json.loads(embedded)["names"] == names
    (points,) = re.findall(r'<script type="application/gzip" id="points-0">(.*?)</script>', text)
    assert b64decode(points) == content.points[0]
    assert unescape(re.findall("<title>(.*)</title>", text)[0]) == r"</title><b>\udcff"


def test_no_script_makes_markup_of_texts() -> None:
    assert {path.relative_to(WEB).as_posix() for path in WEB.rglob("*.js")} == set(SCRIPTS)
    for name in SCRIPTS:
        script = (WEB / name).read_text()
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", script)


def test_it_is_listed_so_that_the_next_map_removes_it(out: Path) -> None:
    before = json.loads((out / SUMMARY).read_text())
    for _ in range(2):
        assert write_report(read_map_folder(out)) == out / REPORT
        after = json.loads((out / SUMMARY).read_text())
        assert after == before | {"files": [*before["files"], REPORT]}
    finished_map(out)
    assert not (out / REPORT).exists()
    assert REPORT not in json.loads((out / SUMMARY).read_text())["files"]


def test_pictures_that_the_map_does_not_list_stay_out(out: Path) -> None:
    (out / "holiday.png").write_bytes(DOT)
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
    """Replace or drop one value, wherever it is, in place."""
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
def test_damaged_folders_end_in_words(tmp_path: Path, seed: int) -> None:
    """Whatever summary.json and graph.json say: a page, or an error that names the file."""
    out = finished_map(tmp_path / "out")
    whole = {name: json.loads((out / name).read_text()) for name in (SUMMARY, FULL_GRAPH)}
    whole[SUMMARY] |= DECIDED
    rng = np.random.default_rng(seed)
    outcomes = {"page": 0, "error": 0}
    said: set[str] = set()
    for _ in range(100 if seed == 1 else 2000):
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
            said.add(str(error).split("(")[0])
            outcomes["error"] += 1
    assert min(outcomes.values()) > 10, outcomes
    assert not [words for words in said if str(out) not in words and "origin" not in words]
