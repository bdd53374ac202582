"""The frame of the command line: exit codes, messages, shared options, progress, the list of devices."""

import io
import json
import os
import pty
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from kernels.device import Device, choose_device
from kernels.errors import DeviceError, InputError
from tools.cli.main import VERBS, app, guarded, run
from tools.cli.options import (
    DeviceOption,
    GridOption,
    MaxTiltOption,
    SeedOption,
    VoxelOption,
    YawPeaksOption,
)
from tools.cli.progress import growing_progress, progress
from tools.cli.terminal import say

ROOT = Path(__file__).parents[1]
SONARMAP = [sys.executable, "-c", "from tools.cli.main import run; run()"]


def sonarmap(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*SONARMAP, *arguments], cwd=ROOT, capture_output=True, text=True, env=os.environ | environment
    )


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
        printed = capsys.readouterr()
        assert printed.err == "error: a.ply: it is [bold]empty[/bold]; give another\n"
        assert printed.out == ""

    def test_a_defect_is_one_line_and_1(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.delenv("SONARMAP_DEBUG", raising=False)
        assert exit_code_of(raiser(ZeroDivisionError("by\nzero"))) == 1
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1
        assert lines[0].startswith("error: this is a defect of sonarmap")
        assert "ZeroDivisionError: by zero (test_cli.py, line" in lines[0]
        assert "SONARMAP_DEBUG=1" in lines[0]

    @pytest.mark.parametrize("error", [ZeroDivisionError("by zero"), InputError("empty")])
    def test_debugging_shows_the_traceback(
        self, error: Exception, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("SONARMAP_DEBUG", "1")
        exit_code_of(raiser(error))
        assert "Traceback (most recent call last)" in capsys.readouterr().err

    def test_an_interruption_is_130(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert exit_code_of(raiser(KeyboardInterrupt())) == 130
        assert capsys.readouterr().err == "stopped; no file is half written\n"

    @pytest.mark.parametrize("ending", [typer.Exit(3), typer.BadParameter("no")])
    def test_what_a_verb_decides_itself_passes(self, ending: Exception) -> None:
        with pytest.raises(type(ending)) as ended:
            guarded(raiser(ending))()
        assert ended.value is ending

    def test_a_verb_that_ends_well_returns(self) -> None:
        assert guarded(lambda: 7)() == 7

    @pytest.mark.parametrize("arguments", [["--bogus"], ["fly"], ["devices", "--bogus"], ["devices", "--device"]])
    def test_usage_errors_are_2(self, arguments: list[str]) -> None:
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2
        assert "Error" in result.stderr
        assert result.stdout == ""

    @pytest.mark.parametrize(("arguments", "code"), [(["--version"], 1), (["devices", "--json"], 141)])
    def test_a_closed_pipe_is_quiet(self, arguments: list[str], code: int) -> None:
        """What is printed before a verb begins is typer's to end, with its own code."""
        reader, writer = os.pipe()
        os.close(reader)
        with os.fdopen(writer, "w") as closed:
            ended = subprocess.run([*SONARMAP, *arguments], cwd=ROOT, stdout=closed, stderr=subprocess.PIPE)
        assert (ended.returncode, ended.stderr) == (code, b"")


class TestMessages:
    def test_what_could_steer_a_terminal_is_escaped(self, capsys: pytest.CaptureFixture[str]) -> None:
        say("scan\x1b[2J\x07\udcff.ply\nsecond line")
        assert capsys.readouterr().err == "scan\\x1b[2J\\x07\\udcff.ply\nsecond line\n"

    def test_a_long_message_stays_whole_in_a_pipe(self, capsys: pytest.CaptureFixture[str]) -> None:
        message = "word " * 100 + "end"
        say(message)
        assert capsys.readouterr().err == f"{message}\n"

    def test_a_long_message_is_wrapped_by_words_on_a_terminal(self) -> None:
        shown = on_a_terminal("from tools.cli.terminal import say; say('harbor ' * 30, 'error: ', 'red')", columns=40)
        lines = [line.rstrip() for line in shown.replace("\x1b[31m", "").replace("\x1b[0m", "").splitlines()]
        assert lines[0] == "error: harbor harbor harbor harbor"
        assert all(len(line) <= 40 and set(line.split()) <= {"error:", "harbor"} for line in lines)


class TestEntry:
    def test_version(self) -> None:
        shown = sonarmap("--version")
        assert (shown.returncode, shown.stdout.split()[0], shown.stderr) == (0, "sonarmap", "")

    def test_help_names_every_verb(self) -> None:
        result = CliRunner().invoke(app, ["--help"])
        assert result.exit_code == 0
        assert all(verb in result.stdout for verb in VERBS)

    @pytest.mark.parametrize("verb", VERBS)
    def test_every_verb_has_its_help(self, verb: str) -> None:
        result = CliRunner().invoke(app, [verb, "--help"])
        assert result.exit_code == 0
        assert f"Usage: sonarmap {verb}" in result.stdout

    def test_an_interruption_before_the_verb_is_130(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setattr("tools.cli.main.app", raiser(KeyboardInterrupt()))
        with pytest.raises(SystemExit) as ended:
            run()
        assert ended.value.code == 130
        assert capsys.readouterr().err == "stopped; no file is half written\n"


class TestSharedOptions:
    """A verb of our own that takes every shared option and prints what arrives."""

    @pytest.fixture
    def verb(self) -> typer.Typer:
        probe = typer.Typer()

        @probe.command()
        def command(
            grid: GridOption = None,
            voxel: VoxelOption = None,
            max_tilt: MaxTiltOption = 35.0,
            yaw_peaks: YawPeaksOption = 6,
            device: DeviceOption = None,
            seed: SeedOption = 0,
        ) -> None:
            typer.echo(f"{grid} {voxel} {max_tilt} {yaw_peaks} {device} {seed}")

        return probe

    def test_defaults(self, verb: typer.Typer) -> None:
        assert CliRunner().invoke(verb, []).stdout == "None None 35.0 6 None 0\n"

    def test_values(self, verb: typer.Typer) -> None:
        arguments = [
            "--grid",
            "64",
            "--voxel",
            "0.5",
            "--max-tilt",
            "12.5",
            "--yaw-peaks",
            "1",
            "--device",
            "cpu",
            "--seed",
            "7",
        ]
        assert CliRunner().invoke(verb, arguments).stdout == "64 0.5 12.5 1 cpu 7\n"

    @pytest.mark.parametrize("edge", ["16", "512"])
    def test_the_ends_of_the_grids_range(self, verb: typer.Typer, edge: str) -> None:
        assert CliRunner().invoke(verb, ["--grid", edge]).exit_code == 0

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ("--grid 100", ["100: wanted", "power of two from 16 to 512", "try --grid 128"]),
            ("--grid 8", ["8: wanted", "try --grid 16"]),
            ("--grid 1024", ["1024: wanted", "try --grid 512"]),
            ("--grid -4", ["-4: wanted", "try --grid 16"]),
            ("--grid many", ["--grid", "integer"]),
            ("--voxel 0", ["0.0 m", "above 0", "--voxel 0.5"]),
            ("--voxel nan", ["nan m", "above 0"]),
            ("--voxel inf", ["inf m", "above 0"]),
            ("--max-tilt -5", ["-5.0 degrees", "more than 0 and at most 180"]),
            ("--max-tilt nan", ["nan degrees"]),
            ("--max-tilt 181", ["181.0 degrees"]),
            ("--yaw-peaks 0", ["0 peaks", "from 1 to 32", "--yaw-peaks 6"]),
            ("--seed -1", ["-1", "whole number", "Use --seed 1"]),
        ],
    )
    def test_refusals(self, verb: typer.Typer, arguments: str, words: list[str]) -> None:
        """Each says what was given, what was wanted and what to do."""
        result = CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(verb, arguments.split())
        assert result.exit_code == 2
        message = " ".join(result.stderr.split())
        assert all(word in message for word in words), message


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

    def test_a_pipe_hears_of_the_time_left(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        clock = iter([0.0, 0.0, 2.0, 6.0, 9.0])  # the start, the plan, three pieces
        monkeypatch.setattr("tools.cli.progress.time.monotonic", lambda: next(clock))
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
            "from tools.cli.progress import progress\n"
            "with progress('pairs', 2) as advance: advance('scan [1]'); advance('scan [2]')"
        )
        assert "pairs" in shown
        assert "2/2" in shown
        assert "scan [2]" in shown


class TestDevices:
    def test_the_table_marks_the_chosen_one(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PYOPENCL_CTX", "")
        device = choose_device()
        result = CliRunner().invoke(app, ["devices"])
        assert result.exit_code == 0
        marked = [line for line in result.stdout.splitlines() if "→" in line]
        assert len(marked) == 1
        assert device.name in marked[0]
        assert device.cl_device.platform.name in marked[0]
        assert "works" in marked[0]

    def test_json(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PYOPENCL_CTX", "")
        device = choose_device()
        shown = sonarmap("devices", "--json", PYOPENCL_CTX="")
        assert (shown.returncode, shown.stderr) == (0, "")
        listed = json.loads(shown.stdout)
        chosen = next(entry for entry in listed["devices"] if entry["selector"] == listed["chosen"])
        assert chosen["name"] == device.name
        assert chosen["works"]
        assert chosen["memory"] >= chosen["largest_allocation"] > 0

    def test_an_unknown_device_is_2(self) -> None:
        result = CliRunner().invoke(app, ["devices", "--device", "abacus"])
        assert result.exit_code == 2
        assert "no OpenCL device matches 'abacus'" in result.stderr

    def test_no_platform_names_the_package_that_brings_one(self, monkeypatch: pytest.MonkeyPatch) -> None:
        import kernels.device

        monkeypatch.setattr(kernels.device.cl, "get_platforms", list)
        result = CliRunner().invoke(app, ["devices"])
        assert result.exit_code == 2
        assert "pocl-opencl-icd" in result.stderr

    def test_devices_that_all_fail_are_listed_and_2(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def no_device(selector: str | None = None) -> Device:
            raise DeviceError("no OpenCL device works")

        monkeypatch.setattr("kernels.device.choose_device", no_device)
        result = CliRunner().invoke(app, ["devices", "--json"])
        assert result.exit_code == 2
        listed = json.loads(result.stdout)
        assert listed["chosen"] is None
        assert listed["devices"]
        assert "no OpenCL device works" in result.stderr


def on_a_terminal(program: str, columns: int = 100) -> str:
    """What a program prints on stderr where that is a terminal."""
    master, terminal = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "CI", "TERM")}
    environment |= {"TERM": "xterm", "COLUMNS": str(columns)}
    with os.fdopen(terminal, "wb") as stderr:
        subprocess.run([sys.executable, "-c", program], cwd=ROOT, stderr=stderr, check=True, env=environment)
    shown = io.BytesIO()
    try:
        while chunk := os.read(master, 4096):
            shown.write(chunk)
    except OSError:  # Linux says EIO where a terminal's other side has gone
        pass
    finally:
        os.close(master)
    return shown.getvalue().decode()
