"""Where a pair's time and memory go: some pairs once more, on a device that notes times and counts its arrays."""

import gc
from dataclasses import replace
from statistics import mean

import numpy as np

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.device.usage import MemoryUsage
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.bench.result import PairResult, StageResult
from sonarmap.tools.lab.bench.stages import PAIR_STAGES, Stage, clocked

# So many of the pairs, after one that does not count.
_PAIRS = 8


def traced(result: PairResult, selector: str | None, grid: Grid, pairs: list[tuple[Scan, Scan]]) -> PairResult:
    """The result with its stages, its memory on the device, and what was reckoned with for it.

    Raises:
        SonarmapError: the scans or the device will not do.
    """
    chosen, config = choose_device(selector), SpectralConfig()
    device = Device(chosen.cl_device, chosen.selector, profiling=True)
    usage = MemoryUsage(device)
    registrar = SpectralRegistrar(device, grid, config)

    def register(target: Scan, source: Scan) -> None:
        registrar.register(registrar.prepare(target), registrar.prepare(source))
        device.queue.finish()

    register(*pairs[0])
    gc.collect()
    usage.restart()
    chosen_pairs = pairs[:_PAIRS]
    with clocked(PAIR_STAGES, device) as clock:
        for target, source in chosen_pairs:
            register(target, source)
    count = len(chosen_pairs)
    # those that none of these pairs needed as well: tables of other pairs have the same rows
    names = dict.fromkeys(PAIR_STAGES.values())
    points = round(mean(len(scan.points) for pair in chosen_pairs for scan in pair))
    return replace(
        result,
        device_memory=usage.most,
        planned_memory=memory_plan(grid.edge, "spectral", points, config.max_tilt).pair,
        stages=tuple(_per_pair(clock.stages.get(name, Stage(name)), count) for name in names),
    )


def _per_pair(stage: Stage, pairs: int) -> StageResult:
    counts = stage.counts
    totals = np.array(
        [
            stage.calls,
            stage.seconds,
            stage.own_seconds,
            sum(counts.kernel_seconds().values()),
            counts.launches,
            counts.reads,
            counts.writes,
            counts.array_bytes,
        ]
    )
    return StageResult(stage.name, *(totals / pairs).tolist())
