"""The examples of docs/examples/ run and print the expected results."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.samples.clutter_scans import scan
from tests.samples.places import ROOT

EXAMPLES = ROOT / "docs" / "examples"


def run(name: str, *arguments: object) -> str:
    """Output of an example."""
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    ended = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.fixture
def survey(tmp_path: Path) -> Path:
    """Four scans of boxes strewn about, a few meters and some degrees apart."""
    folder = tmp_path / "survey"
    folder.mkdir()
    for k in range(4):
        np.save(folder / f"scan_{k}.npy", scan(k))
    return folder


@pytest.mark.slow
def test_examples_run_and_print_results(survey: Path, tmp_path: Path) -> None:
    assert [path.name[:2] for path in sorted(EXAMPLES.glob("*.py"))] == ["01", "02", "03", "04", "05", "06", "07"]
    shown = run("01_register_two_arrays.py")
    assert "accepted: True" in shown
    meters, degrees = (float(word) for word in shown.split("off by ")[1].replace("m,", "").split()[:2])
    assert meters < 0.2
    assert degrees < 0.5
    assert run("02_folder_to_map.py", survey, tmp_path / "map.ply").count("sequential: kept") == 3
    assert (tmp_path / "map.ply").stat().st_size > 10_000
    assert "with it [39.6" in run("03_own_gtsam_factors.py")
    shown = run("04_own_method.py", survey)
    assert "pairs kept" in shown
    assert not shown.startswith("0 of")
    assert "shifted by [  5. -12.  20.]" in run("05_one_kernel.py")
    shown = run("06_write_open_export.py", survey, tmp_path / "map")
    assert "exported: map.laz map.laz.json grid.tif" in shown
    assert shown.count("4 of 4 scans placed") == 2
    assert "points, where there were" in run("07_fuse_again.py", survey)
