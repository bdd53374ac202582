"""The shell's completion, by the protocol that bash, zsh and fish use, and in a real bash."""

import os
import subprocess
import sys

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
