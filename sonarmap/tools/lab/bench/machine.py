"""What a benchmark's figures belong to: the device, the cores, and what else the machine was doing."""

import os
from dataclasses import dataclass
from pathlib import Path

from sonarmap.kernels.device.device import Device


@dataclass(frozen=True, slots=True)
class Machine:
    """Where it was measured.

    Attributes:
        device, platform: the OpenCL device, as the driver gives them.
        processor: the host's, as the system gives it; "" where it does not.
        cores: how many this process may use.
    """

    device: str
    platform: str
    processor: str
    cores: int


def describe_machine(device: Device) -> Machine:
    """The machine that this process runs on."""
    return Machine(device.name, device.platform, _processor(), count_cores())


def count_cores() -> int:
    """Cores that this process may use: fewer than the machine has where it is bound to some."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def load_average() -> float | None:
    """Runnable processes over the last minute, this one's own threads among them; None where not known."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
