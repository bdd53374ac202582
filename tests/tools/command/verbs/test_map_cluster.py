"""`sonarmap map` on a cluster with certificates, and how fast workers are."""

import json
import os
from pathlib import Path
from statistics import median

import pytest

from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.clusters.dask_clusters import as_environment, certificate, dask_commands
from tests.samples.clutter_scans import files_in, scan, write
from tests.samples.command_line import sonarmap

VARYING = {"times.json", "journal.sqlite"}
CLUTTER = ("--grid", "64", "--voxel", "0.35")
REPEATS, SCANS, SEED = 3, 24, 31
QUIET = 0.5  # processes that work before it begins: with more, the times are others', too

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]


def mapped(scans: Path, out: Path, *options: str, **environment: str) -> dict[str, bytes]:
    """What it wrote that is the same whenever it is run."""
    done = sonarmap("map", str(scans), "-o", str(out), *options, **environment)
    assert done.returncode == 0, done.stderr
    return {name: content for name, content in files_in(out).items() if name not in VARYING}


def test_a_cluster_with_certificates_gives_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    write(tmp_path / "scans", **{f"scan_{k}": scan(k) for k in range(4)})
    trusted = as_environment(certificate(tmp_path) | {"require-encryption": "True"})
    expected = mapped(tmp_path / "scans", tmp_path / "here", *CLUTTER)
    with dask_commands(tmp_path, 2, "--protocol", "tls", **trusted) as address:
        assert address.startswith("tls://")
        options = *CLUTTER, "--scheduler", address
        assert mapped(tmp_path / "scans", tmp_path / "there", *options, **trusted) == expected
        refused = sonarmap("map", str(tmp_path / "scans"), "-o", str(tmp_path / "never"), *options)
    assert refused.returncode == 2
    assert "takes no connection" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_two_workers_on_two_cores_are_faster_than_one(tmp_path: Path) -> None:
    """One, two, and a Dask cluster of two in turn; seconds of the registrations, with the start of the workers."""
    write_simulation(simulate(SimulationSettings(count=SCANS, seed=SEED)), tmp_path / "scans")
    load, cores = os.getloadavg()[0], len(os.sched_getaffinity(0))
    seconds: dict[str, list[float]] = {}
    written: dict[str, dict[str, bytes]] = {}
    share = str(max(1, cores // 2))
    with dask_commands(tmp_path, 2, SONARMAP_THREADS=share) as address:
        places = {"one worker": (), "two workers": ("--workers", "2"), "Dask, two": ("--scheduler", address)}
        for _ in range(REPEATS):
            for name, options in places.items():
                out = tmp_path / name
                written[name] = mapped(tmp_path / "scans", out, "--fresh", *options)
                stages = json.loads((out / "times.json").read_text())["stages_s"]
                seconds.setdefault(name, []).append(stages["pairs registered"])
    assert written["two workers"] == written["Dask, two"] == written["one worker"]
    print(f"\n{cores} cores, load {load:.1f} before")
    for name, taken in seconds.items():
        print(f"{name}: {', '.join(f'{s:.1f}' for s in taken)} s, median {median(taken):.1f} s")
    if load < QUIET and cores >= 2:
        assert median(seconds["one worker"]) / median(seconds["two workers"]) >= 1.2
