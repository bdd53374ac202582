"""The shell's completion, by the protocol that bash, zsh and fish use, and in a real bash."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sonarmap.tools.methods.registry import METHODS
from tests.samples.command_line import ROOT
from tests.samples.processor_time import processor_time

CALL = [
    sys.executable,
    "-c",
    "import sys; sys.argv[0] = 'sonarmap'; from sonarmap.tools.command.start import start; start()",
]


def asked(**variables: str) -> str:
    """What the command answers its shell."""
    environment = {**os.environ, **variables, "PYTHONPATH": str(ROOT)}
    return subprocess.run(CALL, env=environment, capture_output=True, text=True, check=True).stdout


def completed(line: str) -> list[str]:
    """What bash is offered for the last word of a command line."""
    words = line.split(" ")
    return asked(_SONARMAP_COMPLETE="complete_bash", COMP_WORDS=line, COMP_CWORD=str(len(words) - 1)).split()


LINES: dict[str, list[str]] = {
    "sonarmap r": ["record", "register", "reproduce"],
    "sonarmap map --max-s": ["--max-speed"],  # rare options too
    "sonarmap map a.ply -o out --method ": list(METHODS),
    "sonarmap export map/ --format eiva": ["eiva-position", "eiva-attitude"],
    "sonarmap simulate --scene s": ["ship", "sandflat", "seabed", "shallow"],
    "sonarmap map --vertical EGM": ["EGM96", "EGM2008"],
    "sonarmap reproduce trans": ["translation"],
    "sonarmap simulate --priors attitude,": ["attitude,heading", "attitude,depth", "attitude,position"],
    "sonarmap map --priors ": [],  # nothing of ours: the shell completes files
    "sonarmap --inst": ["--install-completion"],
    "sonarmap map --device g": ["gpu"],
}
# The command loaded once, and what it answers of each line.
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
    """What bash is offered for the last words of all of LINES."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "_SONARMAP_COMPLETE": "complete_bash"}
    command = [sys.executable, "-c", MANY, *LINES]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert ended.stderr == ""
    *given, rest = ended.stdout.split("answered\n")
    assert rest == ""
    return {line: answer.split() for line, answer in zip(LINES, given, strict=True)}


@pytest.mark.parametrize(("line", "offered"), LINES.items())
def test_what_is_offered(answers: dict[str, list[str]], line: str, offered: list[str]) -> None:
    assert answers[line] == offered


def test_devices_are_offered() -> None:
    offered = completed("sonarmap map --device ")
    assert offered[:2] == ["cpu", "gpu"]
    assert "0:0" in offered


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_a_real_bash(tmp_path: Path) -> None:
    """The script that is installed, sourced, and asked as the Tab key asks."""
    command = tmp_path / "sonarmap"
    command.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -c "{CALL[-1]}" "$@"\n')
    command.chmod(0o755)
    (tmp_path / "script.sh").write_text(asked(_SONARMAP_COMPLETE="source_bash"))
    asks = (
        "source script.sh; COMP_WORDS=(sonarmap evaluate --align f); COMP_CWORD=3; _sonarmap_completion sonarmap; "
        'echo "${COMPREPLY[@]}"; complete -p sonarmap'
    )
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    ended = subprocess.run(
        ["bash", "--norc", "-c", asks], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    offered, installed = ended.stdout.splitlines()
    assert offered == "first"
    assert "-o default" in installed  # files, where nothing of ours is offered


def test_it_answers_before_one_waits() -> None:
    """Without SciPy, Open3D and the like: it computes for 0.3 s; what is checked is far more, for a slow machine."""
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


@pytest.mark.slow
def test_zsh_and_fish_are_told_what_a_word_means() -> None:
    zsh = asked(_SONARMAP_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="sonarmap map --max-")
    assert '"--max-speed":"How fast the vehicle moves at most [m/s]; for scans whose stamps are times."' in zsh
    fish = asked(
        _SONARMAP_COMPLETE="complete_fish", _TYPER_COMPLETE_FISH_ACTION="get-args", _TYPER_COMPLETE_ARGS="sonarmap vi"
    )
    assert fish.startswith("view\tOpen a finished map")
