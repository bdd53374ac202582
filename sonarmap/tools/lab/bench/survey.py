"""A simulated survey mapped from files to files, as `sonarmap map` does it, stage by stage, in a process of its own."""

import io
import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from sonarmap.slam.execute.processes import spawned
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.lab.bench.stages import SURVEY_STAGES, clocked
from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.simulation import simulate
from sonarmap.tools.lab.terminal import Follow

Command = Callable[[Sequence[str]], object]
SCENE = "floodgate"
_OTHER = "all else"


def measure_survey(count: int, seed: int, selector: str | None, follow: Follow, command: Command) -> dict[str, Any]:
    """Simulate a lawn-mower's scans, which is not timed, and map them with nothing but defaults.

    The result has the seconds from reading the files to the last file written, without starting Python, how often a
    scan was prepared, each stage's own seconds, and the memory of the process [bytes].

    Args:
        count: of the scans, at least 2.
        seed: of the scene, the waves and the noise.
        selector: of the device, as `choose_device` takes it.
        follow: reports the progress.
        command: runs `sonarmap` with arguments, in the process that calls it; a function of a module.

    Raises:
        SonarmapError: the survey cannot be mapped.
    """
    with TemporaryDirectory() as folder:
        with follow("simulating a survey", count) as step:
            settings = replace(plan(SCENE, "lawnmower", None, seed), count=count)
            simulation = simulate(settings, progress=lambda done: step(f"scan {done}"))
        write_simulation(simulation, Path(folder) / "scans")
        with follow("mapping the survey", 1) as step, spawned(1) as pool:
            result = pool.submit(_map, Path(folder), selector, command).result()
            step(f"{count} scans")
    return result


def _map(folder: Path, selector: str | None, command: Command) -> dict[str, Any]:
    """In a new process: map the scans of a folder."""
    arguments = ["map", str(folder / "scans"), "-o", str(folder / "map"), "--json"]
    arguments += ["--device", selector] if selector else []
    with clocked(SURVEY_STAGES) as clock, redirect_stdout(io.StringIO()):
        start = perf_counter()
        command(arguments)  # scans in several parts end it with another code, which is no matter here
        seconds = perf_counter() - start
    times = json.loads((folder / "map" / "times.json").read_text(encoding="utf-8"))
    stages = {stage.name: stage.own_seconds for stage in clock.stages.values() if stage.calls}
    return {
        "scans": len(list((folder / "scans").glob("scan_*.ply"))),
        "pairs": len(times["pairs"]),
        "seconds": seconds,
        "prepared": clock.stages["preparing scans"].calls,
        "stages": stages | {_OTHER: seconds - sum(stages.values())},
        "peak_memory": peak_memory(),
    }
