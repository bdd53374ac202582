"""A simulated survey mapped from files to files, as `sonarmap map` does it, stage by stage, in a process of its own."""

import io
import json
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from slam.execute.processes import spawned
from tools.bench.machine import peak_memory
from tools.bench.result import SurveyResult
from tools.bench.stages import SURVEY_STAGES, clocked
from tools.progress import Follow
from tools.simulate.folder import write_simulation
from tools.simulate.plan import plan
from tools.simulate.simulation import simulate

SCENE = "floodgate"
_OTHER = "all else"


def measure_survey(count: int, seed: int, selector: str | None, follow: Follow) -> SurveyResult:
    """Simulate a lawn-mower's scans, which is not timed, and map them with nothing but defaults.

    Args:
        count: of the scans, at least 2.
        seed: of the scene, the waves and the noise.
        selector: of the device, as `choose_device` takes it.
        follow: reports the progress.

    Raises:
        SonarmapError: the survey cannot be mapped.
    """
    with TemporaryDirectory() as folder:
        with follow("simulating a survey", count) as step:
            settings = replace(plan(SCENE, "lawnmower", None, seed), count=count)
            simulation = simulate(settings, progress=lambda done: step(f"scan {done}"))
        write_simulation(simulation, Path(folder) / "scans")
        with follow("mapping the survey", 1) as step, spawned(1) as pool:
            result = pool.submit(_map, Path(folder), selector).result()
            step(f"{count} scans")
    return result


def _map(folder: Path, selector: str | None) -> SurveyResult:
    """In a new process: map the scans of a folder."""
    from tools.cli.main import app

    command = ["map", str(folder / "scans"), "-o", str(folder / "map"), "--json"]
    command += ["--device", selector] if selector else []
    with clocked(SURVEY_STAGES) as clock, redirect_stdout(io.StringIO()):
        start = perf_counter()
        app(command, standalone_mode=False)  # scans in several parts end it with another code, which is no matter here
        seconds = perf_counter() - start
    times = json.loads((folder / "map" / "times.json").read_text(encoding="utf-8"))
    stages = {stage.name: stage.own_seconds for stage in clock.stages.values() if stage.calls}
    scans = len(list((folder / "scans").glob("scan_*.ply")))
    return SurveyResult(
        scans=scans,
        pairs=len(times["pairs"]),
        seconds=seconds,
        prepared=clock.stages["preparing scans"].calls,
        stages=stages | {_OTHER: seconds - sum(stages.values())},
        peak_memory=peak_memory(),
    )
