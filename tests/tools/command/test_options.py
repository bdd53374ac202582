"""--set, exit codes and messages of the command."""

import os
import re
import subprocess
import sys
from collections.abc import Callable

import pytest
import typer

from sonarmap.kernels.errors import InputError
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.tools.command.failures import OPTIONS, guarded
from sonarmap.tools.command.main import VERBS, app
from sonarmap.tools.command.method import changed
from tests.samples.command_line import SONARMAP
from tests.samples.places import ROOT
from tests.samples.refusals import refuses


def test_options_named_in_messages_exist() -> None:
    from typer.main import get_command

    # pyrefly: ignore[missing-attribute]
    commands = [get_command(app).commands[verb] for verb in VERBS]
    options = {option for command in commands for parameter in command.params for option in parameter.opts}
    assert set(OPTIONS.values()) <= options


def test_set_changes_nested_settings() -> None:
    settings = changed(MapperSettings(), ["limits.step=2", "keys.step=0.5", "min_seen=3", "straighten=false"])
    assert (settings.limits.step, settings.keys.step, settings.min_seen, settings.straighten) == (2, 0.5, 3, False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("minseen=3", "there is no 'minseen'; choose from loops, limits"),
        ("straighten=1", "wanted true or false"),
        ("limits.step=fast", "wanted a number"),
        ("limits=2", "there is no ''; choose from speed"),
    ],
)
def test_a_mistake_in_set_is_refused(text: str, words: str) -> None:
    refuses(re.escape(words), changed, MapperSettings(), [text])


def exit_code_of(command: Callable[[], object]) -> int:
    with pytest.raises(typer.Exit) as ended:
        guarded(command)()
    return ended.value.exit_code


def raiser(error: BaseException) -> Callable[[], None]:
    def command() -> None:
        raise error

    return command


class TestExitCodes:
    def test_an_input_error_is_a_message_and_exit_code_2(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert exit_code_of(raiser(InputError("a.ply: it is [bold]empty[/bold]; give another"))) == 2
        assert capsys.readouterr() == ("", "error: a.ply: it is [bold]empty[/bold]; give another\n")

    def test_a_defect_exits_with_1(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delenv("SONARMAP_DEBUG", raising=False)
        assert exit_code_of(raiser(ZeroDivisionError("by\nzero"))) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: this is a defect of sonarmap")
        assert "ZeroDivisionError: by zero (test_options.py, line" in line
        assert "SONARMAP_DEBUG=1" in line

    def test_debugging_shows_the_traceback(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("SONARMAP_DEBUG", "1")
        exit_code_of(raiser(InputError("empty")))
        assert "Traceback (most recent call last)" in capsys.readouterr().err

    def test_a_closed_pipe_exits_with_141_silently(self) -> None:
        reader, writer = os.pipe()
        os.close(reader)
        with os.fdopen(writer, "w") as closed:
            ended = subprocess.run([*SONARMAP, "--version"], cwd=ROOT, stdout=closed, stderr=subprocess.PIPE)
        assert (ended.returncode, ended.stderr) == (141, b"")


def test_ctrl_c_while_libraries_load_exits_with_130_silently() -> None:
    """SIGINT arrives while Python looks for the module of the command line."""
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
