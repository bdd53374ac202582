"""Verdicts, and `sonarmap accept` end to end: exit codes, JSON and the page."""

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.writers.tables import write_json
from sonarmap.tools.products.accept.orders import ORDERS
from sonarmap.tools.products.accept.sheet import Sheet, Verdict, sheet_of
from tests.samples.clutter_scans import done, printed, refused, said, sonarmap
from tests.tools.products.accept.made_up import SIZE, bed, map_folder


def without(points: np.ndarray, edge: float) -> np.ndarray:
    """Points (M, 3) without those of a square at (6, 3) [m]."""
    low = np.array([6.0, 3.0])
    return points[~((points[:, :2] >= low) & (points[:, :2] < low + edge)).all(axis=1)]


def sheet(out: Path, order: str, points: np.ndarray | None = None, cell: float = 1.0, **summary: Any) -> Sheet:
    return sheet_of(read_map_folder(map_folder(out, points, **summary)), order, cell, (0.0, 0.0))


# TVU sqrt(a^2 + (b d)^2) and THU at 17 m, computed by hand from Table 1 of S-44
@pytest.mark.parametrize(
    ("name", "vertical", "horizontal"),
    [
        ("exclusive", 0.196866, 1.0),
        ("special", 0.280635, 2.0),
        ("1a", 0.546663, 5.85),
        ("1b", 0.546663, 5.85),
        ("2", 1.073723, 21.7),
    ],
)
def test_limits_are_those_of_the_standard(tmp_path: Path, name: str, vertical: float, horizontal: float) -> None:
    verdict = sheet(tmp_path / "map", name).verdict
    deep = Verdict.of(ORDERS[name], replace(verdict.cells, depth=np.full(len(verdict.reason), 17.0)))
    assert [float(limit[5]) for limit in deep.limits] == pytest.approx([vertical, horizontal], abs=1e-6)


def test_a_good_map_meets_an_order_and_its_looser_ones(tmp_path: Path) -> None:
    found = sheet(tmp_path / "map", "special", seen=1)
    assert [key for key in ORDERS if found.meets(key)] == ["special", "1a", "1b", "2"]
    assert found.best == "special"
    assert "meets Special Order" in found.sentence
    exclusive = found.verdicts["exclusive"]
    assert exclusive.failing["coverage"] == pytest.approx(1.0)  # one pass, and 200 % is wanted
    assert sum(found.verdict.failing.values()) == 0


def test_a_hole_that_hides_a_feature_breaks_full_coverage(tmp_path: Path) -> None:
    single, large = (sheet(tmp_path / str(edge), "special", without(bed(), edge)) for edge in (1.0, 2.0))
    assert single.meets("special")
    assert not single.verdict.holes.any()
    assert single.verdict.coverage == pytest.approx(1 - 1 / np.prod(SIZE))
    assert not large.meets("special")
    assert large.verdict.holes.sum() == 4
    assert large.verdict.share > 0.95
    assert "4 cells between them are holes" in large.sentence
    assert large.best == "1a"
    assert large.verdict.failing["coverage"] == pytest.approx(4 / np.prod(SIZE))


def test_failures_name_the_largest_term(tmp_path: Path) -> None:
    left = {"forward": 0.0, "left": 2.3, "turn": 0.0, "late": 0.0, "drift_east": 0.0, "drift_north": 0.0}
    noisy = sheet(tmp_path / "noise", "special", bed(0.3))
    floating = sheet(tmp_path / "poses", "special", up=0.5)
    beside = sheet(tmp_path / "position", "special", systematic=left)
    for found, reason in ((noisy, "noise"), (floating, "poses"), (beside, "position")):
        assert not found.meets("special")
        failing = found.verdict.failing
        assert max(failing, key=failing.__getitem__) == reason
        assert failing[reason] > 0.5
    assert beside.best == "1a"


def test_a_map_that_contradicts_its_navigation_meets_no_order(tmp_path: Path) -> None:
    words = "headings are 7.1 standard deviations from the map in the median"
    found = sheet(tmp_path / "map", "2", contradictions=[words], warnings=[words])
    assert found.best is None
    assert found.verdict.met
    assert "contradict" in found.sentence
    assert found.warnings == [words]


class Loaded(HTMLParser):
    """What a page loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]


def test_the_page_and_json_agree_and_exit_codes_say_the_result(tmp_path: Path) -> None:
    folder = map_folder(tmp_path / "a <map>", warnings=["<b> is odd"])
    page = tmp_path / "sheet.html"
    result = sonarmap("accept", folder, "--order", "special", "-o", page, "--json")
    found = printed(result)
    said(result, "<b> is odd")
    assert found["met"]
    assert found["order"] == "special"
    assert found["file"] == str(page)
    assert found["cell_m"] == 1.0
    assert found["cells"] == round(np.prod(SIZE))
    assert found["depths_below"] == "the zero of the navigation's depths"
    text = page.read_text()
    loaded = Loaded(text)
    assert "script" not in loaded.tags
    assert all(each.startswith("data:") for each in loaded.addresses)
    assert not re.search("https?://", text)
    assert found["sentence"] in text
    assert "&lt;b&gt; is odd" in text
    assert "a &lt;map&gt;" in text
    pictures = [each for each in loaded.addresses if each.startswith("data:image")]
    for picture in pictures:
        with Image.open(io.BytesIO(base64.b64decode(picture.split(",")[1]))) as image:
            assert image.format == "PNG"
            assert min(image.size) > 200
    assert len(pictures) == 2
    failed = sonarmap("accept", folder, "--order", "exclusive", "--datum-depth-sigma", "0.2", "-o", page)
    assert failed.exit_code == 3
    assert "does not meet Exclusive Order" in failed.stdout
    assert "vertical datum" in failed.stdout
    done(sonarmap("accept", folder, "--order", "2", "--cell", "2.5", "-o", page))


def test_lines_are_compared_with_the_prediction(tmp_path: Path) -> None:
    folder = map_folder(tmp_path / "map")
    write_json(folder / "lines.json", {"crossings": {"after": {"all": {"std_m": 0.0625}}}})
    crossings = printed(sonarmap("accept", folder, "--order", "2", "-o", tmp_path / "a.html", "--json"))["crossings"]
    assert crossings["lines_observed_m"] == 0.0625
    assert 0.005 < crossings["lines_predicted_m"] < 0.5
    write_json(folder / "lines.json", {"lines": []})
    refused(sonarmap("accept", folder, "--order", "2", "-o", tmp_path / "a.html"), "map again")


def test_a_map_without_its_priors_is_refused(tmp_path: Path) -> None:
    folder = map_folder(tmp_path / "map", unmeasured=["east", "north", "up"])
    result = sonarmap("accept", folder, "--order", "2", "-o", tmp_path / "a.html")
    refused(result, "no prior measures depths (depth_m), positions (x_m")
    assert "roll" not in result.stderr
    assert not (tmp_path / "a.html").exists()
    refused(sonarmap("accept", folder, "--order", "3"), "choose one of exclusive, special")
    refused(sonarmap("accept", folder, "--order", "2", "-o", tmp_path / "a.pdf"), ".html")
    refused(sonarmap("accept", tmp_path / "none", "--order", "2"), "not a folder")
