"""What README and docs tell readers to type runs as it is written, page by page, each page in a folder of its own.

The quick form runs the tutorial alone, with fewer scans and a coarser grid. What is not run is printed with the page's
reason (`pytest -s`).
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sonarmap.tools.command.main import app
from tests.commands.inputs import Inputs
from tests.commands.pages import PAGES, Example, examples, named, starts, words_of
from tests.samples.command_line import SONARMAP
from tests.samples.places import ROOT

LIMIT = 900  # [s] for a command


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return Inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables by which `sonarmap` and `python` are those of this checkout, and a browser does nothing."""
    binaries = tmp_path_factory.mktemp("bin")
    program = f"#!/bin/sh\nexec '{SONARMAP[0]}' {SONARMAP[1]} '{SONARMAP[2]}' \"$@\"\n"
    for name, text in (("sonarmap", program), ("python", f"#!/bin/sh\nexec '{sys.executable}' \"$@\"\n")):
        (binaries / name).write_text(text)
        (binaries / name).chmod(0o755)
    path = f"{binaries}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "BROWSER": shutil.which("true") or "true"}


@pytest.mark.slow
@pytest.mark.timeout(2 * LIMIT)
@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_of_the_page_run(page: Path, inputs: Inputs, environment: dict[str, str], tmp_path: Path) -> None:
    if not examples(page):
        pytest.skip("no commands")
    for name in starts(page):
        inputs.give(name, tmp_path)
    faults = [fault for example in examples(page) if (fault := fault_of(example, tmp_path, environment))]
    assert not faults, "\n".join(faults)


@pytest.mark.slow
def test_the_tutorial_runs_with_few_scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in this process, which has loaded the libraries already."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BROWSER", "true")
    for example in examples(ROOT / "docs/tutorial.md"):
        if not example.not_run:
            smaller = example.text.replace("--scans 12", "--scans 3").replace("sonarmap map", "sonarmap map --grid 48")
            ended = CliRunner().invoke(app, words_of(smaller))
            assert ended.exit_code == 0, f"{example.text}: {ended.output[-2000:]}"


def fault_of(example: Example, folder: Path, environment: dict[str, str]) -> str:
    """Message about a failed example; empty if it succeeded."""
    if example.not_run:
        print(f"not run, {example.not_run}: {example.text}")
        return ""
    command = ["bash", "-c", example.text] if example.language == "sh" else [sys.executable, "-c", example.text]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT)
    if ended.returncode == 0:
        return ""
    return f"{example.text}\nended with {ended.returncode}:\n{ended.stderr[-2000:]}"
