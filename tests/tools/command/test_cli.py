"""The frame of the command line: exit codes, messages, help."""

import os
import subprocess
import sys
from collections.abc import Callable

import pytest
import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import guarded
from sonarmap.tools.command.main import run
from sonarmap.tools.command.terminal import say
from tests.samples.command_line import ROOT, SONARMAP, sonarmap


def exit_code_of(command: Callable[[], object]) -> int:
    with pytest.raises(typer.Exit) as ended:
        guarded(command)()
    return ended.value.exit_code


def raiser(error: BaseException) -> Callable[[], None]:
    def command() -> None:
        raise error

    return command


class TestExitCodes:
    def test_an_error_to_mend_is_a_message_and_2(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert exit_code_of(raiser(InputError("a.ply: it is [bold]empty[/bold]; give another"))) == 2
        assert capsys.readouterr() == ("", "error: a.ply: it is [bold]empty[/bold]; give another\n")

    def test_a_defect_is_1(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delenv("SONARMAP_DEBUG", raising=False)
        assert exit_code_of(raiser(ZeroDivisionError("by\nzero"))) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: this is a defect of sonarmap")
        assert "ZeroDivisionError: by zero (test_cli.py, line" in line
        assert "SONARMAP_DEBUG=1" in line

    @pytest.mark.parametrize("error", [ZeroDivisionError("by zero"), InputError("empty")])
    def test_debugging_shows_the_traceback(
        self, error: Exception, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("SONARMAP_DEBUG", "1")
        exit_code_of(raiser(error))
        assert "Traceback (most recent call last)" in capsys.readouterr().err

    @pytest.mark.parametrize("ending", [typer.Exit(3), typer.BadParameter("no")])
    def test_what_a_verb_decides_itself_passes(self, ending: Exception) -> None:
        with pytest.raises(type(ending)) as ended:
            guarded(raiser(ending))()
        assert ended.value is ending

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("call", ["--version", "devices --json"])
    def test_a_closed_pipe_is_quiet(self, call: str) -> None:
        reader, writer = os.pipe()
        os.close(reader)
        with os.fdopen(writer, "w") as closed:
            ended = subprocess.run([*SONARMAP, *call.split()], cwd=ROOT, stdout=closed, stderr=subprocess.PIPE)
        assert (ended.returncode, ended.stderr) == (141, b"")


class TestMessages:
    def test_what_could_steer_a_terminal_is_escaped(self, capsys: pytest.CaptureFixture[str]) -> None:
        say("scan\x1b[2J\x07\udcff.ply\nsecond line")
        assert capsys.readouterr().err == "scan\\x1b[2J\\x07\\udcff.ply\nsecond line\n"


class TestEntry:
    def test_an_interruption_before_the_verb_is_130(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr("sonarmap.tools.command.main.app", raiser(KeyboardInterrupt()))
        with pytest.raises(SystemExit) as ended:
            run()
        assert ended.value.code == 130
        assert capsys.readouterr().err == "stopped: nothing was written\n"

    def test_an_interruption_while_libraries_load_is_130_without_a_word(self) -> None:
        """The interruption comes as the command line itself is looked for."""
        program = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, *_):
        if name == "sonarmap.tools.command.main":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from sonarmap.tools.command.start import start
start()
"""
        ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
        assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")

    @pytest.mark.slow
    def test_version(self) -> None:
        shown = sonarmap("--version")
        assert (shown.returncode, shown.stdout.split()[0], shown.stderr) == (0, "sonarmap", "")
