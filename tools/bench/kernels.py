"""Run the cases of the kernels."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from kernels.device.device import Device
from tools.bench.case import KernelCase
from tools.bench.cases.all_cases import CASES
from tools.bench.result import KernelResult
from tools.bench.timing import interleave
from tools.bench.workload import Workload


def measure_kernels(
    device: Device, edges: Sequence[int], repeats: int, seed: int, cores: int, step: Callable[[str], None]
) -> Iterator[KernelResult]:
    """Every case on every edge.

    Args:
        device: what the kernels run on.
        edges: N, each.
        repeats: how often each kernel is timed.
        seed: of the input.
        cores: threads that the twins may use.
        step: called after each case with its name.

    Raises:
        DeviceError: the device cannot hold an array.
    """
    for edge in edges:
        workload = Workload(device, edge, cores, seed)
        for make in CASES:
            result = measure_case(make(workload), device, edge, repeats)
            step(f"{result.name} at {edge}^3")
            yield result


def measure_case(case: KernelCase, device: Device, edge: int, repeats: int) -> KernelResult:
    """Time one kernel and its twin in turns, then compare what they made in one more round."""

    def run() -> None:
        case.run()
        device.queue.finish()

    times, twin_times = interleave(run, case.twin, repeats, case.restore)
    case.restore()
    run()
    error = relative_difference(case.read(), case.twin())
    return KernelResult(case.name, case.twin_name, edge, times, twin_times, case.moved, error, case.tolerance)


def relative_difference(got: np.ndarray, wanted: np.ndarray) -> float:
    """Relative L2 difference; infinite where the shapes differ."""
    if got.shape != wanted.shape:
        return float("inf")
    return float(np.linalg.norm(got - wanted) / np.linalg.norm(wanted))
