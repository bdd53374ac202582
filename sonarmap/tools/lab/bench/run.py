"""A whole benchmark: the copy rate, the kernels, the pairs, and a survey mapped from scan files to map files.

The result is the object that `sonarmap bench --json` prints. Other programs read it: do not rename its keys.
"""

import io
import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.processes import spawned
from sonarmap.spectral.grid import Grid
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.files.user_file import package_versions
from sonarmap.tools.lab.bench.cases import CASES, peer_versions
from sonarmap.tools.lab.bench.kernels import measure_kernels
from sonarmap.tools.lab.bench.pairs import measure_pairs, simulate_pairs
from sonarmap.tools.lab.bench.stages import SURVEY_STAGES, clocked
from sonarmap.tools.lab.bench.timing import count_cores, load_average, measure_copy_rate, processor_name
from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.simulation import simulate
from sonarmap.tools.lab.terminal import Follow

Command = Callable[[Sequence[str]], object]
SCENE = "floodgate"
_OTHER = "all else"
_RATE_REPEATS = 5


@dataclass(frozen=True, slots=True)
class BenchPlan:
    """The extent of a benchmark."""

    edges: Sequence[int]  # voxels per edge of each grid
    repeats: int  # timed runs of each kernel
    pairs: int  # number of simulated pairs that are registered on each grid, 0 for none
    kernels: bool  # whether to time the kernels
    survey: int  # number of scans of the simulated survey, 0 for none
    seed: int  # of all simulated input


def run_bench(selector: str | None, plan: BenchPlan, follow: Follow, command: Command) -> dict[str, Any]:
    """Measure on the device that `choose_device` selects; numbers in the result may be of NumPy's types.

    `command` runs `sonarmap` with arguments in a spawned process; it is a module's function. Raises InputError: an
    edge is invalid, or there is nothing to measure; DeviceError: the device does not exist or is too small.
    """
    for edge in plan.edges:
        Grid(edge, 1.0)
    if not (plan.kernels or plan.pairs or plan.survey):
        raise InputError("--no-kernels and --pairs 0 leave nothing to measure; leave one of them out")
    if plan.survey == 1:
        raise InputError("--survey 1: a survey needs 2 scans or more; 0 maps none")
    if plan.pairs or plan.survey:
        import_module("open3d")  # the simulator needs it; fail now if it is missing, not after a minute of kernels
    chosen = choose_device(selector)
    device = Device(chosen.cl_device, chosen.selector, chosen.notes, profiling=True)
    cores, before = count_cores(), load_average()
    rates = measure_copy_rate(device, _RATE_REPEATS)
    kernels: list[dict[str, Any]] = []
    if plan.kernels:
        with follow("timing kernels", len(plan.edges) * len(CASES)) as step:
            kernels += measure_kernels(device, plan.edges, plan.repeats, plan.seed, cores, step)
    # measured again, as the load of the machine may have changed
    copy_rate = float(np.median(rates + measure_copy_rate(device, _RATE_REPEATS)))
    pairs = _pairs(selector, plan, follow) if plan.pairs else []
    survey = measure_survey(plan.survey, plan.seed, selector, follow, command) if plan.survey else None
    return {
        "device": {"name": device.name, "platform": device.platform},
        "processor": processor_name(),
        "cores": cores,
        "versions": package_versions() | peer_versions(),
        "load_average": (before, load_average()),
        "seed": plan.seed,
        "repeats": plan.repeats,
        "copy_rate": copy_rate,
        "kernels": [row | {"rate_over_copy_rate": row["rate"] / copy_rate} for row in kernels],
        "pairs": pairs,
        "survey": survey,
    }


def _pairs(selector: str | None, plan: BenchPlan, follow: Follow) -> list[dict[str, Any]]:
    with follow("simulating pairs", plan.pairs) as step:
        simulated = simulate_pairs(plan.pairs, plan.seed, step)
    with follow("registering pairs", len(plan.edges) * plan.pairs) as step:
        return [measure_pairs(simulated, edge, selector, step) for edge in plan.edges]


def measure_survey(count: int, seed: int, selector: str | None, follow: Follow, command: Command) -> dict[str, Any]:
    """Simulate `count` scans along a lawnmower path and map them in a new process with default settings.

    The result has the seconds from reading the first file to writing the last, each stage's own seconds, and the memory
    of the process [bytes]. Raises SonarmapError: the survey cannot be mapped.
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
    """Map the scans of a folder in this spawned process."""
    arguments = ["map", str(folder / "scans"), "-o", str(folder / "map"), "--json"]
    arguments += ["--device", selector] if selector else []
    with clocked(SURVEY_STAGES) as clock, redirect_stdout(io.StringIO()):
        start = perf_counter()
        command(arguments)  # its exit code, which is not 0 for a map in several components, does not matter here
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
