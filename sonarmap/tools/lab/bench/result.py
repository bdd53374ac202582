"""What one kernel's measurement gave, and its row of a benchmark's result.

A result is the one object that `sonarmap bench --json` prints: seconds, bytes and bytes per second throughout. Other
programs read it: names stay.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from sonarmap.tools.lab.bench.timing import Times


@dataclass(frozen=True, slots=True)
class KernelResult:
    """One kernel beside its twin."""

    # name, twin_name, edge: which kernel, what its twin is made of, N
    name: str
    twin_name: str
    edge: int
    # device, twin: times of the two [s]
    device: Times
    twin: Times
    moved: int  # bytes that the algorithm must move
    error: float  # relative L2 difference of the two results
    tolerance: float  # the largest that is right
    peers: Mapping[str, Times]  # times of other libraries, by their names [s]
    compile_seconds: float  # building the programs, and what the first run took longer [s]
    launches: int  # kernels that one run launches
    blocking_reads: int  # how often the host waits for the device within the run
    # the device's own time by kernel, the median of some runs [s]; nothing where it notes no times
    kernel_seconds: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def right(self) -> bool:
        """Whether the results agree; not where the error is NaN."""
        return self.error <= self.tolerance

    def row(self, copy_rate: float) -> dict[str, Any]:
        """The kernel's row of the result, compared with how fast the device copies [bytes/s]."""
        median = self.device.median
        rate = self.moved / median
        return {
            "kernel": self.name,
            "twin": self.twin_name,
            "grid": self.edge,
            "device_seconds": asdict(self.device),
            "twin_seconds": asdict(self.twin),
            "ratio": self.twin.median / median,
            "bytes_moved": self.moved,
            "rate": rate,
            "rate_over_copy_rate": rate / copy_rate,
            "error": self.error,
            "tolerance": self.tolerance,
            "right": self.right,
            "compile_seconds": self.compile_seconds,
            "launches": self.launches,
            "blocking_reads": self.blocking_reads,
            "event_seconds": sum(self.kernel_seconds.values()) if self.kernel_seconds else None,
            "kernel_seconds": dict(self.kernel_seconds),
            "peers": [
                {"library": name, "seconds": asdict(times), "ratio": times.median / median}
                for name, times in self.peers.items()
            ],
        }
