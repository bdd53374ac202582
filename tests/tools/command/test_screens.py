"""Progress and results on terminals of 80 columns and fewer; few lines elsewhere."""

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.progress import growing_progress, progress
from tests.samples.screens import on_screen

LONG = "scan_008 - scan_009: accepted: it is right with a probability of 99.6 %: " + "the views agree and so on; " * 8
COUNTING = f"""
import time
from sonarmap.tools.command.progress import growing_progress
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
        clock = iter([0.0, 0.0, 0.0, 2.0, 6.0, 9.0])  # the start, the plan, three pieces
        monkeypatch.setattr("sonarmap.tools.command.progress.time.monotonic", lambda: next(clock))
        with progress("pairs", 3) as advance:
            for _ in range(3):
                advance("")
        assert capsys.readouterr().err == "pairs: 2 of 3, 6.0 s, about 3 s left\npairs: 3 of 3, 9.0 s\n"

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
