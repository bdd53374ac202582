"""Shared options, --set, shell completion, exit codes and messages of the command."""

import os
import re
import subprocess
import sys
from collections.abc import Callable

import pytest
import typer
from typer.testing import CliRunner, Result

from sonarmap.kernels.errors import InputError
from sonarmap.slam.mapper import MapperSettings
from sonarmap.tools.command.failures import OPTIONS, as_options, guarded
from sonarmap.tools.command.main import VERBS, app, run
from sonarmap.tools.command.method import MethodOptions, changed
from sonarmap.tools.command.option import spread
from sonarmap.tools.command.terminal import say
from sonarmap.tools.methods.registry import METHODS
from tests.samples.command_line import SONARMAP, sonarmap
from tests.samples.places import ROOT
from tests.samples.processor_time import processor_time
from tests.samples.refusals import refuses


def probe_result(arguments: str) -> Result:
    """Result of a probe verb that takes every shared option and prints the values."""
    probe, names = typer.Typer(), ("grid", "voxel", "max_tilt", "settings", "device", "seed")

    def command(method: MethodOptions) -> None:
        typer.echo(" ".join(str(getattr(method, name)) for name in names))

    probe.command()(spread(command))
    return CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(probe, arguments.split())


class TestSharedOptions:
    @pytest.mark.parametrize(
        ("arguments", "printed"),
        [
            ("", "None None None [] None None"),
            (
                "--grid 64 --voxel 0.5 --max-tilt 12.5 --set hypotheses=64 --set keys.step=2 --device cpu --seed 7",
                "64 0.5 12.5 ['hypotheses=64', 'keys.step=2'] cpu 7",
            ),
        ],
    )
    def test_values_reach_the_verb(self, arguments: str, printed: str) -> None:
        assert probe_result(arguments).stdout == f"{printed}\n"

    @pytest.mark.parametrize("edge", ["16", "90", "96", "512"])
    def test_grid_sizes_at_the_limits_are_accepted(self, edge: str) -> None:
        assert probe_result(f"--grid {edge}").exit_code == 0


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("`edge=98` is not; try `edge=96` or `edge=100`", "--grid 98 is not; try --grid 96 or --grid 100"),
        ("`bandwidth=7` and `stack`", "bandwidth=7 and stack"),
        ("run `sonarmap map` first", "run `sonarmap map` first"),
    ],
)
def test_messages_name_options_instead_of_arguments(message: str, shown: str) -> None:
    assert as_options(message) == shown


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
        ("min_seen=2.5", "wanted a whole number, as in --set min_seen=2"),
        ("straighten=1", "wanted true or false"),
        ("limits.step=fast", "wanted a number"),
        ("limits=2", "there is no ''; choose from speed"),
        ("min_seen.x=2", "wanted a whole number"),
        ("min_seen=0", "`min_seen=0`"),
    ],
)
def test_a_mistake_in_set_is_refused(text: str, words: str) -> None:
    refuses(re.escape(words), changed, MapperSettings(), [text])


CALL = [
    sys.executable,
    "-c",
    "import sys; sys.argv[0] = 'sonarmap'; from sonarmap.tools.command.start import start; start()",
]


def shell_output(**variables: str) -> str:
    """Output of the command for shell completion."""
    environment = {**os.environ, **variables, "PYTHONPATH": str(ROOT)}
    return subprocess.run(CALL, env=environment, capture_output=True, text=True, check=True).stdout


def completed(line: str) -> list[str]:
    """Completions that bash gets for the last word of a command line."""
    words = line.split(" ")
    return shell_output(_SONARMAP_COMPLETE="complete_bash", COMP_WORDS=line, COMP_CWORD=str(len(words) - 1)).split()


LINES: dict[str, list[str]] = {
    "sonarmap r": ["record", "register", "reproduce"],
    "sonarmap map --max-s": ["--max-speed"],  # rare options too
    "sonarmap map a.ply -o out --method ": list(METHODS),
    "sonarmap export map/ --format eiva": ["eiva-position", "eiva-attitude"],
    "sonarmap simulate --scene s": ["ship", "sandflat", "seabed", "shallow"],
    "sonarmap map --vertical EGM": ["EGM96", "EGM2008"],
    "sonarmap reproduce trans": ["translation"],
    "sonarmap simulate --priors attitude,": ["attitude,heading", "attitude,depth", "attitude,position"],
    "sonarmap map --priors ": [],  # the shell itself completes files
    "sonarmap --inst": ["--install-completion"],
    "sonarmap map --device g": ["gpu"],
}
# Load the command once, and print its completions of each line.
MANY = """
import os, sys
from sonarmap.tools.command.start import start
lines, sys.argv[:] = sys.argv[1:], ["sonarmap"]
for line in lines:
    os.environ.update(COMP_WORDS=line, COMP_CWORD=str(line.count(" ")))
    try:
        start()
    except SystemExit:
        print("answered")
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, list[str]]:
    """Completions that bash gets for the last word of each of LINES."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "_SONARMAP_COMPLETE": "complete_bash"}
    command = [sys.executable, "-c", MANY, *LINES]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert ended.stderr == ""
    *given, rest = ended.stdout.split("answered\n")
    assert rest == ""
    return {line: answer.split() for line, answer in zip(LINES, given, strict=True)}


@pytest.mark.parametrize(("line", "offered"), LINES.items())
def test_completions_of_the_last_word(answers: dict[str, list[str]], line: str, offered: list[str]) -> None:
    assert answers[line] == offered


def test_completion_is_quick_and_loads_no_slow_library() -> None:
    """It takes about 0.3 s of processor time; the limit of 5 s leaves room for slow machines."""
    start = processor_time()
    completed("sonarmap map --")
    assert processor_time() - start < 5
    listed = subprocess.run(
        [CALL[0], "-X", "importtime", *CALL[1:]],
        env={**os.environ, "PYTHONPATH": str(ROOT), "_SONARMAP_COMPLETE": "complete_bash", "COMP_CWORD": "2",
             "COMP_WORDS": "sonarmap map --"},
        capture_output=True, text=True, check=True,
    ).stderr  # fmt: skip
    imported = {line.rpartition("|")[2].strip().partition(".")[0] for line in listed.splitlines()}
    assert not imported & {"scipy", "open3d", "matplotlib", "pyopencl", "gtsam", "pyproj", "rasterio"}


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

    @pytest.mark.parametrize("error", [ZeroDivisionError("by zero"), InputError("empty")])
    def test_debugging_shows_the_traceback(
        self, error: Exception, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("SONARMAP_DEBUG", "1")
        exit_code_of(raiser(error))
        assert "Traceback (most recent call last)" in capsys.readouterr().err

    @pytest.mark.parametrize("ending", [typer.Exit(3), typer.BadParameter("no")])
    def test_exceptions_of_typer_pass_unchanged(self, ending: Exception) -> None:
        with pytest.raises(type(ending)) as ended:
            guarded(raiser(ending))()
        assert ended.value is ending

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("call", ["--version", "devices --json"])
    def test_a_closed_pipe_exits_with_141_silently(self, call: str) -> None:
        reader, writer = os.pipe()
        os.close(reader)
        with os.fdopen(writer, "w") as closed:
            ended = subprocess.run([*SONARMAP, *call.split()], cwd=ROOT, stdout=closed, stderr=subprocess.PIPE)
        assert (ended.returncode, ended.stderr) == (141, b"")


class TestMessages:
    def test_control_characters_are_escaped(self, capsys: pytest.CaptureFixture[str]) -> None:
        say("scan\x1b[2J\x07\udcff.ply\nsecond line")
        assert capsys.readouterr().err == "scan\\x1b[2J\\x07\\udcff.ply\nsecond line\n"


class TestEntry:
    def test_ctrl_c_before_the_verb_exits_with_130(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr("sonarmap.tools.command.main.app", raiser(KeyboardInterrupt()))
        with pytest.raises(SystemExit) as ended:
            run()
        assert ended.value.code == 130
        assert capsys.readouterr().err == "stopped: nothing was written\n"

    def test_ctrl_c_while_libraries_load_exits_with_130_silently(self) -> None:
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

    @pytest.mark.slow
    def test_version_is_printed(self) -> None:
        shown = sonarmap("--version")
        assert (shown.returncode, shown.stdout.split()[0], shown.stderr) == (0, "sonarmap", "")
