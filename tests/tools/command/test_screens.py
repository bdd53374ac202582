"""Progress and results on terminals of 80 columns and fewer; few lines elsewhere."""

from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.terminal import growing_progress, progress
from tests.samples.clutter_scans import scan, write
from tests.samples.screens import on_screen

LONG = "scan_008 - scan_009: accepted: it is right with a probability of 99.6 %: " + "the views agree and so on; " * 8
COUNTING = f"""
import time
from sonarmap.tools.command.terminal import growing_progress
with growing_progress("mapping") as step:
    for k in range(41):
        step(k, 57 if k < 20 else 1200, {LONG!r})
        time.sleep(0.05)
"""


@pytest.mark.parametrize("columns", [60, *(pytest.param(n, marks=pytest.mark.slow) for n in (80, 120))])
def test_bar_count_and_time_left_stay_whatever_is_said_of_a_pair(columns: int) -> None:
    shown = on_screen(COUNTING, columns=columns, when=r"\b3\d/1200")
    line, words = shown.moment
    assert line.startswith("mapping ")
    assert "━" * 4 in line
    assert "/1200 0:0" in line
    assert line.endswith(" left")
    assert "about 0:0" in line
    assert words.startswith("  scan_008 - scan_009: accepted")
    assert words.endswith("…")
    assert max(map(len, shown.moment)) <= columns
    assert len(shown.lines) == 1  # what is over is a line
    assert "40/1200" in shown.lines[0]
    assert "left" not in shown.lines[0]


class TestProgress:
    def test_quiet_says_nothing(self, capsys: pytest.CaptureFixture[str]) -> None:
        with progress("pairs", 2, quiet=True) as advance:
            advance("one")
            advance("two")
        assert capsys.readouterr() == ("", "")

    def test_a_pipe_gets_few_lines(self, capsys: pytest.CaptureFixture[str]) -> None:
        with progress("pairs", 100) as advance:
            for _ in range(100):
                advance("a [note]")
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert printed.err.startswith("pairs: 100 of 100, ")
        assert printed.err.endswith("(a [note])\n")

    def test_the_time_left(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        clock = [0.0]
        monkeypatch.setattr("sonarmap.tools.command.terminal.time.monotonic", lambda: clock[0])
        with progress("pairs", 3) as advance:
            for clock[0] in (2.0, 6.0, 9.0):
                advance("")
        assert capsys.readouterr().err == "pairs: 2 of 3, 6.0 s, about 4 s left\npairs: 3 of 3, 9.0 s\n"

    def test_the_plan_may_grow(self, capsys: pytest.CaptureFixture[str]) -> None:
        with growing_progress("mapping") as step:
            step(1, 2, "0 - 1")
            step(2, 5, "1 - 2")
        said = capsys.readouterr().err
        assert said.startswith("mapping: 2 of 5, ")
        assert said.endswith(" s left (1 - 2)\n")

    def test_an_error_ends_it_without_a_word(self, capsys: pytest.CaptureFixture[str]) -> None:
        def fail_after_one() -> None:
            with progress("pairs", 2) as advance:
                advance("one")
                raise InputError("no")

        with pytest.raises(InputError):
            fail_after_one()
        assert capsys.readouterr().err == ""


GRID = ("--grid", "64")


SONARMAP = "from sonarmap.tools.command.main import run; run()"


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four in scans/, one of them of another place; beside them a copy and a file that is no scan."""
    folder = tmp_path_factory.mktemp("dive") / "scans"
    folder.mkdir()
    write(folder, a=scan(0), b=scan(1), b_copy=scan(1), c=scan(2), d=scan(3, scene=2))
    (folder / "e.ply").write_text("hello")
    return folder.parent


@pytest.mark.slow
def test_a_map_that_is_incomplete_is_told_on_a_screen(scans: Path) -> None:
    shown = on_screen(SONARMAP, "map", "scans", "scans/a.ply", "-o", "out", *GRID, folder=scans)
    assert shown.exit_code == 3
    assert len(shown.lines) <= 24  # the summary is among them
    start = next(k for k, line in enumerate(shown.lines) if line.startswith("scans "))
    assert shown.lines[start] == "scans     4 of 6 placed in one map (1 in no map, 1 cannot be read)"
    rows = [line.split()[0] for line in shown.lines[start : start + 6]]
    assert rows == ["scans", "loops", "track", "map", "time", "warning:"]
    words = " ".join(line.strip() for line in shown.lines)
    assert "warning: 1 of 5 scans is in no map" in words
    assert "next      sonarmap view out " in words
    assert "report.html" in words


@pytest.mark.slow
def test_a_message_while_a_bar_is_shown_stands_above_it() -> None:
    program = COUNTING.replace("        time", "        if k == 5: say('a message')\n        time")
    shown = on_screen("from sonarmap.tools.command.terminal import say\n" + program)
    assert [line.split()[0] for line in shown.lines] == ["a", "mapping"]


@pytest.mark.slow
def test_a_table_of_pairs_keeps_its_numbers(scans: Path) -> None:
    for columns in (60, 80):
        command = ("map", "scans", "-o", "out", *GRID, "--verbose")
        shown = on_screen(SONARMAP, *command, columns=columns, rows=80, folder=scans)
        head = next(k for k, line in enumerate(shown.lines) if line.startswith("pair "))
        assert {"role", "peak", "overlap", "sigmas"} <= set(shown.lines[head].split())
        assert ("distance" in shown.lines[head]) == (columns == 80)
        assert shown.lines[head + 1].startswith("a - b")
        assert "…" not in "".join(shown.lines[head : head + 5])


@pytest.mark.slow
def test_what_is_wrong_with_files_is_told_once(scans: Path) -> None:
    shown = on_screen(SONARMAP, "map", "scans", "scans/a.ply", "-o", "out", *GRID, folder=scans, rows=60)
    words = " ".join(line.strip() for line in shown.lines)
    assert words.count("e.ply") == 1
    assert "given more than once, and used once: scans/a.ply" in words
    assert "the same points twice: b_copy of b; leave the copies out" in words
