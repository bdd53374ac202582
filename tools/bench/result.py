"""The result of a benchmark, and its form in JSON."""

from dataclasses import dataclass
from typing import Any

from tools.bench.machine import Machine
from tools.bench.timing import Times

# Seconds per registration of the paper (Sect. 3: MATLAB, 2010), by voxels per edge.
PAPER_SECONDS = {128: 10.5, 256: 60.6}


@dataclass(frozen=True, slots=True)
class KernelResult:
    """One kernel beside its twin.

    Attributes:
        name, twin_name, edge: which kernel, what its twin is made of, N.
        device, twin: times of the two [s].
        moved: what the algorithm must move [bytes].
        error: relative L2 difference of the two results.
        tolerance: the largest that is right.
    """

    name: str
    twin_name: str
    edge: int
    device: Times
    twin: Times
    moved: int
    error: float
    tolerance: float

    @property
    def ratio(self) -> float:
        """How many times as long the twin takes, by medians."""
        return self.twin.median / self.device.median

    @property
    def rate(self) -> float:
        """Bytes that must be moved over the median time [bytes/s]."""
        return self.moved / self.device.median

    @property
    def right(self) -> bool:
        """Whether the results agree; not where the error is NaN."""
        return self.error <= self.tolerance


@dataclass(frozen=True, slots=True)
class PairResult:
    """Prepared pairs of simulated scans on one grid, in a process that did only this.

    Attributes:
        edge, voxel: the grid [voxels, m].
        prepare: times of preparing each scan [s].
        register: times of registering each pair of prepared scans [s].
        accepted: how many pairs the registration believed.
        right: how many are within 6 degrees and 3 voxels of the truth.
        peak_memory: of the whole process [bytes].
    """

    edge: int
    voxel: float
    prepare: Times
    register: Times
    accepted: int
    right: int
    peak_memory: int


@dataclass(frozen=True, slots=True)
class BenchResult:
    """One run of the benchmark.

    Attributes:
        machine: where.
        seed, repeats: as asked for.
        copy_rate: the device's own, reads and writes counted [bytes/s].
        load: load average before and after.
        kernels, pairs: the rows.
    """

    machine: Machine
    seed: int
    repeats: int
    copy_rate: float
    load: tuple[float | None, float | None]
    kernels: tuple[KernelResult, ...]
    pairs: tuple[PairResult, ...]

    @property
    def wrong(self) -> list[KernelResult]:
        """The kernels whose results are not their twins'."""
        return [kernel for kernel in self.kernels if not kernel.right]


def as_json(result: BenchResult) -> dict[str, Any]:
    """One object; seconds, bytes and bytes per second throughout."""
    from tools.versions import package_versions
    from tools.writers.json_text import to_json

    return to_json(
        {
            "device": {"name": result.machine.device, "platform": result.machine.platform},
            "processor": result.machine.processor,
            "cores": result.machine.cores,
            "versions": package_versions(),
            "load_average": result.load,
            "seed": result.seed,
            "repeats": result.repeats,
            "copy_rate": result.copy_rate,
            "kernels": [_kernel_row(kernel, result.copy_rate) for kernel in result.kernels],
            "pairs": [_pair_row(pair) for pair in result.pairs],
        }
    )


def _kernel_row(kernel: KernelResult, copy_rate: float) -> dict[str, Any]:
    return {
        "kernel": kernel.name,
        "twin": kernel.twin_name,
        "grid": kernel.edge,
        "device_seconds": kernel.device,
        "twin_seconds": kernel.twin,
        "ratio": kernel.ratio,
        "bytes_moved": kernel.moved,
        "rate": kernel.rate,
        "rate_over_copy_rate": kernel.rate / copy_rate,
        "error": kernel.error,
        "tolerance": kernel.tolerance,
        "right": kernel.right,
    }


def _pair_row(pair: PairResult) -> dict[str, Any]:
    return {
        "grid": pair.edge,
        "voxel": pair.voxel,
        "prepare_seconds": _with_spread(pair.prepare),
        "register_seconds": _with_spread(pair.register),
        "paper_seconds": PAPER_SECONDS.get(pair.edge),
        "accepted": pair.accepted,
        "right": pair.right,
        "peak_memory": pair.peak_memory,
    }


def _with_spread(times: Times) -> dict[str, Any]:
    return {name: getattr(times, name) for name in times.__slots__} | {"most_over_median": times.most_over_median}
