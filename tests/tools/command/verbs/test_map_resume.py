"""`sonarmap map` killed at random moments, with several workers, or with more scans: the files have the same bytes, and
no finished pair is registered again."""

import json
import os
import signal
import sqlite3
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.clutter_scans import files_in, scan, sonarmap, write
from tests.samples.command_line import SONARMAP
from tests.samples.places import ROOT

KILLS, SEED = 20, 7
CLUTTER = ("--grid", "64", "--voxel", "0.35")
GRID = ("--grid", "64", "--voxel", "1.5")
VARYING = {"times.json", "journal.sqlite", "journal.sqlite-journal"}


def start(scans: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    """Start the command as the head of a process group."""
    command, pipe = [*SONARMAP, "map", str(scans), "-o", str(out), *GRID, *options], subprocess.PIPE
    return subprocess.Popen(command, cwd=ROOT, text=True, start_new_session=True, stdout=pipe, stderr=pipe)


def run(scans: Path, out: Path, *options: str) -> tuple[dict[str, bytes], float]:
    """Run the command; the files that every run writes identically, and the time it took [s]."""
    begin = time.perf_counter()
    mapping = start(scans, out, *options)
    _, errors = mapping.communicate()
    assert mapping.returncode == 0, errors
    return results(out), time.perf_counter() - begin


def results(out: Path) -> dict[str, bytes]:
    return {name: content for name, content in files_in(out).items() if name not in VARYING}


def computed(out: Path) -> list[int]:
    """How many times each pair in the journal was registered."""
    with sqlite3.connect(out / "journal.sqlite") as database:
        counts = [count for (count,) in database.execute("SELECT computed FROM entry")]
    database.close()
    return counts


def entries(out: Path) -> int:
    """Number of results in the locked journal of a run; the last may not be committed yet."""
    try:
        with sqlite3.connect(f"file:{out / 'journal.sqlite'}?mode=ro&immutable=1", uri=True) as database:
            return database.execute("SELECT count(*) FROM entry").fetchone()[0]
    except sqlite3.DatabaseError:  # not there yet, or just being written
        return 0


def times(out: Path) -> dict[str, Any]:
    return json.loads((out / "times.json").read_text())


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve scans of a flood gate."""
    folder = tmp_path_factory.mktemp("scans")
    write_simulation(simulate(SimulationSettings(count=12, seed=33)), folder)
    return folder


@pytest.fixture(scope="module")
def undisturbed(scans: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed")
    run(scans, out)
    return out


pytestmark = pytest.mark.timeout(3000)


@pytest.fixture(scope="module")
def clutter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four small scans, and in out/ the map of an undisturbed run."""
    folder = tmp_path_factory.mktemp("clutter")
    write(folder, **{f"scan_{k}": scan(k) for k in range(4)})
    assert sonarmap("map", folder, "-o", folder / "out", *CLUTTER).exit_code == 0
    return folder


@pytest.mark.slow
def test_two_workers_give_the_same_bytes(clutter: Path, tmp_path: Path) -> None:
    assert sonarmap("map", clutter, "-o", tmp_path, *CLUTTER, "--workers", "2").exit_code == 0
    assert results(tmp_path) == results(clutter / "out")
    assert times(tmp_path)["workers"] == 2


@pytest.mark.slow
def test_killed_at_random_moments_map_gives_the_same_bytes(scans: Path, undisturbed: Path, tmp_path: Path) -> None:
    """SIGKILL ends the process group, which has one or two workers at random. A survey that ends before the 20 kills
    are done is compared, and another one is started."""
    rng = np.random.default_rng(SEED)
    expected, least = results(undisturbed), len(computed(undisturbed))
    _, whole = run(scans, tmp_path / "timed")
    kills, outs, lost, found = 0, [tmp_path / "out 0"], 0, 0
    while True:
        patience = rng.uniform(0.0, whole) if kills < KILLS else None
        mapping = start(scans, outs[-1], "--workers", str(rng.integers(1, 3)))
        try:
            _, errors = mapping.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            os.killpg(mapping.pid, signal.SIGKILL)
            mapping.communicate()
            kills += 1
            continue
        assert mapping.returncode == 0, errors
        assert results(outs[-1]) == expected
        counts = computed(outs[-1])
        assert len(counts) == least
        lost += sum(counts) - len(counts)
        found += times(outs[-1])["pairs_from_journal"]
        if kills == KILLS:
            break
        outs.append(tmp_path / f"out {len(outs)}")
    assert lost == 0
    print(
        f"{kills} kills, {len(outs)} surveys of {least} pairs finished; {found} of {len(outs) * least} pairs were kept"
    )


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("workers", ["1", "2"])
def test_stop_and_resume(scans: Path, undisturbed: Path, tmp_path: Path, sent: signal.Signals, workers: str) -> None:
    mapping = start(scans, tmp_path, "--workers", workers)
    counted: set[int] = set()
    while len(counted - {0, 1}) < 2:  # once the next piece of work is in the journal, the one before has been counted
        time.sleep(0.1)
        assert mapping.poll() is None
        counted.add(entries(tmp_path))
    os.killpg(mapping.pid, sent) if sent == signal.SIGINT else mapping.send_signal(sent)
    printed, errors = mapping.communicate()
    assert (mapping.returncode, printed) == (130, "")
    assert "done and kept in" in errors.splitlines()[-1]
    assert errors.endswith("journal.sqlite; the same command continues from there\n")
    assert "Traceback" not in errors
    assert _is_gone(mapping.pid)
    assert run(scans, tmp_path)[0] == results(undisturbed)
    assert max(computed(tmp_path)) == 1


def _is_gone(group: int) -> bool:
    """Whether all processes of a group end within a minute; the resource tracker of Python ends last."""
    for _ in range(600):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    print(subprocess.run(["ps", "-o", "pid,stat,args", "-g", str(group)], capture_output=True, text=True).stdout)
    return False
