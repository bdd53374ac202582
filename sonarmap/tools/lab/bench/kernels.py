"""Times the kernels of all cases."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.trace import Counts, tracing
from sonarmap.tools.lab.bench.cases import CASES, KernelCase
from sonarmap.tools.lab.bench.stages import BUILDS, build_seconds, clocked
from sonarmap.tools.lab.bench.timing import interleave, timed
from sonarmap.tools.lab.bench.workload import Workload

_TRACED = 7  # number of runs that are timed by the device's clock


def measure_kernels(
    device: Device, edges: Sequence[int], repeats: int, seed: int, cores: int, step: Callable[[str], None]
) -> Iterator[dict[str, Any]]:
    """The rows of all cases on grids of each edge, with `cores` threads for peers; `step` is called after each.

    Kernel times are only known on a device with profiling. Raises DeviceError: the device cannot hold an array.
    """
    for edge in edges:
        workload = Workload(device, edge, cores, seed)
        for make in CASES:
            with clocked(BUILDS) as clock:
                case = make(workload)
            row = measure_case(case, device, edge, repeats, build_seconds(clock))
            step(f"{case.name} at {edge}^3")
            yield row


def measure_case(
    case: KernelCase, device: Device, edge: int, repeats: int, built_seconds: float = 0.0
) -> dict[str, Any]:
    """Time a kernel and its peers in turns.

    The row has seconds, bytes and bytes per second. `built_seconds` is the time that its programs took to build.
    """
    peers = case.peers()

    def run() -> None:
        case.run()
        device.queue.finish()

    def restore() -> None:
        case.restore()
        for peer in peers:
            peer.restore()

    restore()
    with clocked(BUILDS) as clock:
        first_seconds, _ = timed(run)
    times, *peer_times = interleave([run, *(peer.run for peer in peers)], repeats, restore)
    counts, kernel_seconds = _trace(case, device)
    median = times.median
    return {
        "kernel": case.name,
        "grid": edge,
        "device_seconds": asdict(times),
        "bytes_moved": case.moved,
        "rate": case.moved / median,
        # the extra time of the first run counts as compiling
        "compile_seconds": built_seconds + max(build_seconds(clock), first_seconds - median),
        "launches": counts.launches,
        "blocking_reads": counts.reads,
        "event_seconds": sum(kernel_seconds.values()) if kernel_seconds else None,
        "kernel_seconds": kernel_seconds,
        "peers": [
            {"library": peer.name, "seconds": asdict(spent), "ratio": spent.median / median}
            for peer, spent in zip(peers, peer_times, strict=True)
        ],
    }


def _trace(case: KernelCase, device: Device) -> tuple[Counts, dict[str, float]]:
    """Counts of a run's device calls, and median seconds of each of its kernels; empty without profiling."""
    rounds: list[Counts] = []
    for _ in range(_TRACED):
        case.restore()
        device.queue.finish()
        counts = Counts()
        rounds.append(counts)
        with tracing(device, lambda counts=counts: counts):
            case.run()
        device.queue.finish()
    times = [counts.kernel_seconds() for counts in rounds]
    return rounds[0], {name: float(np.median([run[name] for run in times])) for name in times[0]}
