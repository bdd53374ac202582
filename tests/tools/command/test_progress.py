"""Progress on stderr: a bar on a terminal, few lines elsewhere."""

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.progress import growing_progress, progress
from tests.samples.command_line import on_a_terminal


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

    def test_a_terminal_gets_a_bar(self) -> None:
        shown = on_a_terminal(
            "from time import sleep; from sonarmap.tools.command.progress import progress\n"
            "with progress('pairs', 2) as advance: advance('scan [1]'); sleep(1); advance('scan [2]')"
        )
        assert "pairs" in shown
        assert "2/2" in shown
        assert "scan [1]" in shown
