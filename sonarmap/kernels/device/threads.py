"""How many threads this process may use. Only the standard library is imported here, as libraries read their numbers
when they are loaded."""

import os
from math import ceil
from pathlib import Path

from sonarmap.kernels.errors import InputError

# What a user sets, and `share_cores` in the processes that it starts.
VARIABLE = "SONARMAP_THREADS"
_QUOTA = Path("/sys/fs/cgroup/cpu.max")
# What libraries read: PoCL before version 4, PoCL since, OpenMP (Open3D, small_gicp), the BLAS of NumPy and SciPy.
_OF_LIBRARIES = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def thread_count() -> int:
    """How many threads this process may use: what SONARMAP_THREADS says, else one for every core that it may run on."""
    wanted = os.environ.get(VARIABLE)
    if wanted is None:
        return _cores()
    if not (wanted.isascii() and wanted.isdigit() and int(wanted) > 0):
        raise InputError(f"the environment's {VARIABLE} is {wanted!r}; wanted a whole number of at least 1, or nothing")
    return int(wanted)


def share_cores(processes: int) -> None:
    """Have this process, one of `processes` at the same time, and the libraries that it loads use its share of the
    cores."""
    os.environ.setdefault(VARIABLE, str(max(1, _cores() // processes)))
    limit_libraries()


def limit_libraries() -> None:
    """Have the libraries that are loaded from now on use the threads that SONARMAP_THREADS allows, or, if the machine
    has more, the cores that this process may run on. A library's own variable counts for more."""
    if VARIABLE in os.environ or _cores() < (os.cpu_count() or 1):
        for name in _OF_LIBRARIES:
            os.environ.setdefault(name, str(thread_count()))


def _cores() -> int:
    """How many cores this process may keep busy; a container or taskset may leave only some."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(there, _quota(there)))


def _quota(there: int) -> int:
    """How many cores' time a container may take (Linux, version 2 of control groups); `there` where nothing says so."""
    try:
        most, period = _QUOTA.read_text(encoding="ascii").split()
        return ceil(int(most) / int(period))
    except (OSError, ValueError, ZeroDivisionError):  # no such file, or it says "max"
        return there
