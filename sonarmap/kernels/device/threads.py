"""The number of threads of this process. Only the standard library is imported here, since other libraries read their
thread counts when they are loaded."""

import os
from math import ceil
from pathlib import Path

from sonarmap.kernels.errors import InputError

# Set by the user, or by `share_cores` in worker processes.
VARIABLE = "SONARMAP_THREADS"
_QUOTA = Path("/sys/fs/cgroup/cpu.max")
# Read by PoCL before version 4, PoCL since, OpenMP (Open3D), and the BLAS of NumPy and SciPy.
_OF_LIBRARIES = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def thread_count() -> int:
    """Number of threads that this process may use: SONARMAP_THREADS, else one per core that it may run on."""
    wanted = os.environ.get(VARIABLE)
    if wanted is None:
        return _cores()
    if not (wanted.isascii() and wanted.isdigit() and int(wanted) > 0):
        raise InputError(f"the environment variable {VARIABLE} is {wanted!r}; set a whole number above 0, or unset it")
    return int(wanted)


def share_cores(processes: int) -> None:
    """Limit this process, one of `processes` that run at the same time, and its libraries to its share of the threads
    of their parent, whose environment it has."""
    whole = thread_count()
    os.environ[VARIABLE] = share = str(max(1, whole // processes))
    for name in _OF_LIBRARIES:
        if os.environ.get(name) == str(whole):  # as `limit_libraries` set it in the parent
            os.environ[name] = share
    limit_libraries()


def limit_libraries() -> None:
    """Limit libraries that are loaded from now on to `thread_count` threads, if SONARMAP_THREADS is set or this process
    may use only some of the machine's cores. A library's own variable has precedence."""
    if VARIABLE in os.environ or _cores() < (os.cpu_count() or 1):
        for name in _OF_LIBRARIES:
            os.environ.setdefault(name, str(thread_count()))


def _cores() -> int:
    """Number of cores that this process may use, at least 1; a container or taskset may limit it."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(there, _quota(there)))


def _quota(there: int) -> int:
    """Number of cores that a container's CPU quota allows (Linux, cgroup v2); `there` if it has no quota."""
    try:
        most, period = _QUOTA.read_text(encoding="ascii").split()
        return ceil(int(most) / int(period))
    except (OSError, ValueError, ZeroDivisionError):  # no such file, or it says "max"
        return there
