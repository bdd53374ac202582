"""How fast `sonarmap map` is with several workers."""

import json
import os
from pathlib import Path
from statistics import median

import pytest

from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.clutter_scans import files_in
from tests.samples.command_line import sonarmap

VARYING = {"times.json", "journal.sqlite"}
REPEATS, SCANS, SEED = 3, 24, 31
QUIET = 0.5  # processes that work before it begins: with more, the times are others', too

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]


def mapped(scans: Path, out: Path, *options: str) -> dict[str, bytes]:
    """What it wrote that is the same whenever it is run."""
    done = sonarmap("map", str(scans), "-o", str(out), *options)
    assert done.returncode == 0, done.stderr
    return {name: content for name, content in files_in(out).items() if name not in VARYING}


def test_two_workers_on_two_cores_are_faster_than_one(tmp_path: Path) -> None:
    """One and two in turn; seconds of the registrations, with the start of the workers."""
    write_simulation(simulate(SimulationSettings(count=SCANS, seed=SEED)), tmp_path / "scans")
    load, cores = os.getloadavg()[0], len(os.sched_getaffinity(0))
    seconds: dict[str, list[float]] = {}
    written: dict[str, dict[str, bytes]] = {}
    for _ in range(REPEATS):
        for name, options in {"one worker": (), "two workers": ("--workers", "2")}.items():
            out = tmp_path / name
            written[name] = mapped(tmp_path / "scans", out, "--fresh", *options)
            stages = json.loads((out / "times.json").read_text())["stages_s"]
            seconds.setdefault(name, []).append(stages["pairs registered"])
    assert written["two workers"] == written["one worker"]
    print(f"\n{cores} cores, load {load:.1f} before")
    for name, taken in seconds.items():
        print(f"{name}: {', '.join(f'{s:.1f}' for s in taken)} s, median {median(taken):.1f} s")
    if load < QUIET and cores >= 2:
        assert median(seconds["one worker"]) / median(seconds["two workers"]) >= 1.2
