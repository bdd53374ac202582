"""A whole benchmark: the copy rate, the kernels, the pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.files.inputs import package_versions
from sonarmap.tools.lab.bench.copying import measure_copy_rate
from sonarmap.tools.lab.bench.kernels import CASES, measure_kernels
from sonarmap.tools.lab.bench.machine import count_cores, load_average, processor_name
from sonarmap.tools.lab.bench.pairs import measure_pairs, simulate_pairs
from sonarmap.tools.lab.bench.peers import peer_versions
from sonarmap.tools.lab.bench.result import KernelResult
from sonarmap.tools.lab.bench.survey import Command, measure_survey
from sonarmap.tools.lab.terminal import Follow

_RATE_REPEATS = 5


@dataclass(frozen=True, slots=True)
class BenchPlan:
    """What a benchmark measures."""

    edges: Sequence[int]  # voxels per edge, each
    repeats: int  # timed runs of each kernel
    pairs: int  # how many simulated pairs to register on each edge; 0 for none
    kernels: bool  # whether to time the kernels
    survey: int  # how many scans of a simulated survey to map; 0 for none
    seed: int  # of all input


def run_bench(selector: str | None, plan: BenchPlan, follow: Follow, command: Command) -> dict[str, Any]:
    """Measure on one device; the result as `result.py` says, with numbers of any kind.

    Args:
        selector: of the device, as `choose_device` takes it.
        follow: reports the progress.
        command: as `measure_survey` takes it.

    Raises:
        InputError: an edge is not a grid's, or nothing is left to measure.
        DeviceError: there is no such device, or it is too small.
    """
    for edge in plan.edges:
        Grid(edge, 1.0)
    if not (plan.kernels or plan.pairs or plan.survey):
        raise InputError("--no-kernels and --pairs 0 leave nothing to measure; leave one of them out")
    if plan.survey == 1:
        raise InputError("--survey 1: a survey needs 2 scans or more; 0 maps none")
    if plan.pairs or plan.survey:
        import_module("open3d")  # of the simulator: missing, it is said now and not after a minute of kernels
    chosen = choose_device(selector)
    device = Device(chosen.cl_device, chosen.selector, chosen.notes, profiling=True)
    cores, before = count_cores(), load_average()
    rates = measure_copy_rate(device, _RATE_REPEATS)
    kernels: list[KernelResult] = []
    if plan.kernels:
        with follow("timing kernels", len(plan.edges) * len(CASES)) as step:
            kernels += measure_kernels(device, plan.edges, plan.repeats, plan.seed, cores, step)
    # again, as the machine's other work may have changed meanwhile
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
        "kernels": [kernel.row(copy_rate) for kernel in kernels],
        "pairs": pairs,
        "survey": survey,
    }


def _pairs(selector: str | None, plan: BenchPlan, follow: Follow) -> list[dict[str, Any]]:
    with follow("simulating pairs", plan.pairs) as step:
        simulated = simulate_pairs(plan.pairs, plan.seed, step)
    with follow("registering pairs", len(plan.edges) * plan.pairs) as step:
        return [measure_pairs(simulated, edge, selector, step) for edge in plan.edges]
