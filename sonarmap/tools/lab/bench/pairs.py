"""Time and memory of preparing scans and registering pairs, measured in a separate process; some pairs are measured
again by stage, on a device that profiles kernels and counts its arrays."""

import gc
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from functools import lru_cache
from typing import Any

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.device.trace import MemoryUsage
from sonarmap.kernels.errors import DeviceError
from sonarmap.slam.execute.processes import spawned
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.lab.bench.stages import PAIR_STAGES, Stage, clocked
from sonarmap.tools.lab.bench.timing import summarize, timed
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.simulate.random_pairs import random_pair
from sonarmap.tools.lab.simulate.sensing.noise import Noise

_TRACED_PAIRS = 8  # after one for warming up
_PAPER_SECONDS = {128: 10.5, 256: 60.6}  # per registration, by voxels per edge (Sect. 3: MATLAB, 2010)


def _trace(selector: str | None, grid: Grid, pairs: list[tuple[Scan, Scan]]) -> dict[str, Any]:
    """Cells of the row of `measure_pairs`: stages of a pair, its memory on the device, and the planned memory."""
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
    with clocked(PAIR_STAGES, device) as clock:
        for target, source in pairs:
            register(target, source)
    # all stages, even those without calls, so that tables of other pairs have the same rows
    names = dict.fromkeys(PAIR_STAGES.values())
    return {
        "device_memory": usage.most,
        "planned_memory": memory_plan(grid.edge).pair,
        "stages": [_per_pair(clock.stages.get(name, Stage(name)), len(pairs)) for name in names],
    }


def _per_pair(stage: Stage, pairs: int) -> dict[str, Any]:
    counts = stage.counts
    totals = {
        "calls": stage.calls,
        "seconds": stage.seconds,
        "own_seconds": stage.own_seconds,
        "device_seconds": sum(counts.kernel_seconds().values()),
        **{name: getattr(counts, name) for name in ("launches", "reads", "writes", "array_bytes")},
    }
    return {"name": stage.name} | {name: float(total / pairs) for name, total in totals.items()}


SimulatedPair = tuple[Scan, Scan, RigidTransform]  # target, source, T_target_source

_SIGMA2 = 1.0  # the paper's noise: variance of the range at the sensor's maximum range [m^2]


def simulate_pairs(count: int, seed: int, step: Callable[[str], None]) -> list[SimulatedPair]:
    """Pairs of scans of different scenes; `step` is called after each."""
    pairs = []
    for n in range(count):
        pairs.append(random_pair(seed + n, noise=Noise(sigma2=_SIGMA2)))
        step(f"pair {n + 1}")
    return pairs


def measure_pairs(
    pairs: list[SimulatedPair], edge: int, selector: str | None, step: Callable[[str], None]
) -> dict[str, Any]:
    """Prepare and register every pair in a spawned process, and return the row of the result.

    Memory is that of the whole process and of all arrays on the device [bytes]; stages are per pair; `step` is called
    after each pair. The voxel fits all scans. Raises SonarmapError: the scans or the device cannot be used.
    """
    grid = choose_grid((scan for pair in pairs for scan in pair[:2]), edge)
    with spawned(1) as pool:
        try:
            # the first pair is timed separately: kernels are compiled at their first launch
            first, _ = pool.submit(timed, _measure_pair, selector, grid, pairs[0]).result()
            measured: list[_Measured] = []
            for n, pair in enumerate(pairs):
                measured.append(pool.submit(_measure_pair, selector, grid, pair).result())
                step(f"pair {n + 1} at {grid.edge}^3")
            memory = pool.submit(peak_memory).result()
            traced = pool.submit(_trace, selector, grid, [pair[:2] for pair in pairs[:_TRACED_PAIRS]]).result()
        except BrokenProcessPool:
            raise DeviceError(
                "the process that registers pairs was killed, probably as memory ran out. Use a smaller --grid, or "
                "--pairs 0 to leave pairs out."
            ) from None
    preparing, registering, accepted, right = zip(*measured, strict=True)
    return {
        "grid": grid.edge,
        "voxel": grid.voxel,
        "prepare_seconds": _with_longest([seconds for both in preparing for seconds in both]),
        "register_seconds": _with_longest(registering),
        "paper_seconds": _PAPER_SECONDS.get(grid.edge),
        "accepted": sum(accepted),
        "right": sum(right),
        "peak_memory": memory,
        "first_seconds": first,
    } | traced


def _with_longest(seconds: Sequence[float]) -> dict[str, float]:
    times = summarize(seconds)
    return asdict(times) | {"most_over_median": times.most / times.median}


# Of a pair: seconds to prepare each scan, seconds to register them, whether the result is accepted and is right
_Measured = tuple[list[float], float, bool, bool]


@lru_cache(maxsize=1)
def _registrar(selector: str | None, grid: Grid) -> SpectralRegistrar:
    """The registrar of the spawned process."""
    return SpectralRegistrar(choose_device(selector), grid, SpectralConfig())


def _measure_pair(selector: str | None, grid: Grid, pair: SimulatedPair) -> _Measured:
    """Measure a pair in the spawned process; at most two prepared scans are held."""
    registrar = _registrar(selector, grid)

    def prepare(scan: Scan) -> SpectralScan:
        prepared = registrar.prepare(scan)
        registrar.device.queue.finish()
        return prepared

    (first, target), (second, source) = (timed(prepare, scan) for scan in pair[:2])
    seconds, result = timed(registrar.register, target, source)
    return [first, second], seconds, result.accepted, pair_error(result.T_target_source, pair[2]).is_right(grid.voxel)
