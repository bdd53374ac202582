"""A result that is stored, compared, drawn, and written into a page."""

import copy
import json
import re
from itertools import combinations
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from typer.testing import CliRunner

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.bench.kernels import CASES
from sonarmap.tools.lab.bench.output.compare import compare, read_result
from sonarmap.tools.lab.bench.output.page import BEGIN, END, figures, write_page
from sonarmap.tools.lab.bench.output.picture import draw_roofline, roofline_figure
from tests.samples.places import ROOT

PAGE = ROOT / "docs" / "benchmarks.md"
_SPACE = 0.5  # by which boxes may touch [pixels]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a short run."""
    path = tmp_path_factory.mktemp("bench") / "result.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sonarmap.tools.lab.bench.rates._LARGEST", 2**20)
        arguments = ["bench", "--grid", "16", "--repeats", "2", "--pairs", "1", "--out", str(path)]
        assert CliRunner().invoke(app, arguments).exit_code == 0
    return path


@pytest.fixture
def result(stored: Path) -> dict[str, Any]:
    return json.loads(stored.read_text())


def _slower(result: dict[str, Any], share: float) -> dict[str, Any]:
    """The same with the first kernel and the pair slower by a share."""
    changed = copy.deepcopy(result)
    for times in (changed["kernels"][1]["device_seconds"], changed["pairs"][0]["register_seconds"]):
        for name in ("median", "first_quartile", "third_quartile", "least", "most"):
            times[name] *= 1 + share
    return changed


def _steady(result: dict[str, Any]) -> dict[str, Any]:
    """The same without noise."""
    steady = copy.deepcopy(result)
    rows = [row["device_seconds"] for row in steady["kernels"]]
    rows += [row[name] for row in steady["pairs"] for name in ("prepare_seconds", "register_seconds")]
    for times in rows:
        for name in ("first_quartile", "third_quartile", "least", "most"):
            times[name] = times["median"]
    return steady


@pytest.mark.slow
class TestCompare:
    @pytest.mark.slow
    def test_a_run_is_no_worse_than_itself(self, result: dict[str, Any]) -> None:
        comparison = compare(result, result)
        assert comparison.changes == comparison.notes == ()
        assert comparison.compared == len(CASES) + 2 + 3

    @pytest.mark.slow
    def test_slower_beyond_the_noise(self, result: dict[str, Any]) -> None:
        steady = _steady(result)
        comparison = compare(steady, _slower(steady, 0.5))
        whats = [change.what for change in comparison.regressions]
        assert whats == ["RealFFT.forward at 16^3", "register a pair at 16^3"]
        assert all("1.50 times as long" in change.new for change in comparison.regressions)
        faster = compare(_slower(steady, 0.5), steady)
        assert faster.regressions == ()
        assert len(faster.changes) == 2

    def test_within_the_noise_nothing_differs(self, result: dict[str, Any]) -> None:
        steady = _steady(result)
        assert compare(steady, _slower(steady, 0.09)).changes == ()
        noisy = copy.deepcopy(steady)
        for row in noisy["kernels"]:
            row["device_seconds"]["third_quartile"] *= 2
        noisy["pairs"][0]["register_seconds"]["third_quartile"] *= 2
        assert compare(noisy, _slower(steady, 0.5)).changes == ()

    def test_more_launches_and_fewer_right_answers_are_worse(self, result: dict[str, Any]) -> None:
        changed = copy.deepcopy(result)
        changed["pairs"][0]["stages"][-1]["launches"] += 1000
        changed["pairs"][0]["right"] -= 1
        whats = [change.what for change in compare(result, changed).regressions]
        assert whats == ["launches of a pair at 16^3", "pairs right at 16^3"]

    def test_other_machines_are_named(self, result: dict[str, Any]) -> None:
        changed = result | {"cores": 64, "copy_rate": 2 * result["copy_rate"]}
        first, second = compare(result, changed).notes
        assert "differ in their cores" in first
        assert "GB/s then" in second

    def test_a_result_of_before_these_keys(self, result: dict[str, Any]) -> None:
        old = copy.deepcopy(result)
        for row in old["pairs"]:
            del row["stages"], row["device_memory"]
        assert compare(old, result).compared == len(CASES) + 2


class TestCommand:
    def test_regressions_end_with_4(self, stored: Path, result: dict[str, Any], tmp_path: Path) -> None:
        old, new = tmp_path / "old.json", tmp_path / "new.json"
        old.write_text(json.dumps(_steady(result)))
        new.write_text(json.dumps(_slower(_steady(result), 0.5)))
        worse = CliRunner().invoke(app, ["bench", "--from", str(new), "--compare", str(old)])
        assert worse.exit_code == 4
        assert "worse: RealFFT.forward at 16^3" in worse.stderr
        assert "2 worse, 0 better" in worse.stderr
        assert CliRunner().invoke(app, ["bench", "--from", str(old), "--compare", str(new)]).exit_code == 0

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["--from", "missing.json"], "cannot read missing.json"),
            (["--compare", "missing.json"], "cannot read missing.json"),
            (["--from", "RESULT", "--grid", "64"], "--grid has no effect"),
            (["--from", "RESULT", "--page", "RESULT"], "does not hold the lines"),
            (["--survey", "1", "--no-kernels", "--pairs", "0"], "needs 2 scans"),
            (["--grid", "98"], "--grid 98 is not an even product of 2, 3 and 5"),
            (["--no-kernels", "--pairs", "0"], "nothing to measure"),
            (["--device", "abacus"], "no OpenCL device matches 'abacus'"),
            (["--repeats", "0"], "--repeats"),
            (["--pairs", "-1"], "--pairs"),
        ],
    )
    def test_refusals(self, stored: Path, arguments: list[str], words: str) -> None:
        given = [str(stored) if argument == "RESULT" else argument for argument in arguments]
        refused = CliRunner().invoke(app, ["bench", *given])
        assert refused.exit_code == 2
        assert words in " ".join(refused.stderr.split())

    @pytest.mark.parametrize(
        "content", ["", "[]", "{}", '{"kernels": 3, "pairs": []}', '{"kernels": [{}], "pairs": []}']
    )
    def test_other_files_are_no_results(self, tmp_path: Path, content: str) -> None:
        path = tmp_path / "other.json"
        path.write_text(content)
        with pytest.raises(InputError, match="is not a result of `sonarmap bench`"):
            read_result(path)

    @pytest.mark.parametrize("key", ["right", "first_quartile", "prepare_seconds", "copy_rate"])
    def test_a_result_that_lacks_something(self, stored: Path, tmp_path: Path, key: str) -> None:
        """Wherever it is: nothing is compared with a file that was damaged, and that is none of our defects."""
        damaged = tmp_path / "damaged.json"
        damaged.write_text(stored.read_text().replace(f'"{key}"', '"lost"'))
        refused = CliRunner().invoke(app, ["bench", "--from", str(stored), "--compare", str(damaged)])
        assert refused.exit_code == 2
        assert "is not a result of `sonarmap bench`" in " ".join(refused.stderr.split())


class TestPage:
    def test_the_page_has_the_form_that_the_command_writes(self, result: dict[str, Any]) -> None:
        """Its numbers are of another run; its tables, their columns and their rows are those of now."""
        written = PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
        ours = _tables(
            figures(result | {"survey": {"scans": 2, "pairs": 1, "seconds": 1.0, "prepared": 2, "stages": {}}})
        )
        page = _tables(written)
        assert {title for title in ours if not title.startswith("A survey")} <= set(page)
        for title, (headings, rows) in ours.items():
            if title in page:
                assert page[title][0] == headings
                if title.startswith(("Kernels", "Where")):
                    assert page[title][1] == rows

    def test_only_what_is_between_the_marks_is_replaced(self, result: dict[str, Any], tmp_path: Path) -> None:
        path = tmp_path / "page.md"
        path.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
        write_page(path, result)
        write_page(path, result)
        text = path.read_text()
        assert text.startswith(f"before\n{BEGIN}\n")
        assert text.endswith(f"{END}\nafter\n")
        assert "old" not in text
        assert text.count("**Pairs**") == 1


def _tables(text: str) -> dict[str, tuple[str, list[str]]]:
    """Tables by title, the grid left out: the line of headings, and what the first column holds."""
    tables = {}
    for title, body in re.findall(r"\*\*(.+?)\*\*\n\n((?:\|.*\n)+)", text):
        lines = body.splitlines()
        tables[re.sub(r" at \d+³| of \d+ scans.*", "", title)] = (
            lines[0],
            [line.split(" | ")[0] for line in lines[2:]],
        )
    return tables


def overlapping_texts(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of texts that are drawn in a figure and whose boxes share pixels, and texts that leave the figure."""
    boxes: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def record(text: Text, renderer: RendererBase) -> None:
        if text.get_visible() and text.get_text().strip():
            boxes.append((text.get_text(), Text.get_window_extent(text, renderer)))
        draw(text, renderer)

    with patch.object(Text, "draw", record):
        FigureCanvasAgg(figure).draw()
    sheet = figure.bbox.padded(_SPACE)
    inside = {id(box) for _, box in boxes if sheet.contains(*box.min) and sheet.contains(*box.max)}
    outside = [(text, "the figure's edge") for text, box in boxes if id(box) not in inside]
    pairs = combinations([(text, box.padded(-_SPACE)) for text, box in boxes], 2)
    return outside + [(a, b) for (a, first), (b, second) in pairs if first.overlaps(second)]


def test_the_picture_is_a_picture(result: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "roofline.png"
    draw_roofline(path, result)
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    with pytest.raises(InputError, match="holds no kernels"):
        draw_roofline(path, result | {"kernels": []})


def test_the_picture_names_every_kernel_of_the_last_grid_and_no_name_lies_upon_another(result: dict[str, Any]) -> None:
    (row,) = [row for row in result["kernels"] if row.get("flops") and row["right"]][:1]
    rng = np.random.default_rng(1)
    rows = [
        {**row, "grid": grid, "kernel": f"Kernel.step_{k}", "flops": flops, "bytes_moved": 1.0, "flop_rate": rate}
        for grid in (64, 128)
        for k, (flops, rate) in enumerate(np.exp(rng.normal([0, 23], [1.0, 0.7], (14, 2))).tolist())
    ]
    figure = roofline_figure(result | {"kernels": rows})
    assert overlapping_texts(figure) == []
    names = {text.get_text() for text in figure.axes[0].texts}
    assert {f"Kernel.step_{k}" for k in range(14)} <= names
    assert "named are the kernels at 128³" in figure.texts[1].get_text()
