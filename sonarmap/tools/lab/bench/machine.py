"""What a benchmark's figures belong to: the host's processor and cores, and what else the machine was doing."""

import os
from pathlib import Path


def processor_name() -> str:
    """The host's, as the system gives it; "" where it does not."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def count_cores() -> int:
    """Cores that this process may use: fewer than the machine has where it is bound to some."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def load_average() -> float | None:
    """Runnable processes over the last minute, this one's own threads among them; None where not known."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
