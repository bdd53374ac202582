"""Available memory of this machine, checked before a large allocation."""

import os
import re
from pathlib import Path

from sonarmap.kernels.counted import sized
from sonarmap.kernels.errors import InputError

_UNKNOWN = 4 << 30  # assumed memory where the system does not report it [bytes]
_GROUPS, _OWN_GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
_SHELL, _CONTAINER = "ulimit -v", "the control group"
# Measured memory and address space (which `ulimit -v` limits) of the program with its libraries, the OpenCL driver and
# its compiler, without arrays [bytes].
_PROGRAM, _ADDRESSES = 400 << 20, 1400 << 20


def require_memory(what: str, needed: int, remedy: str) -> None:
    """Raise InputError if `what` needs more than the available memory; `needed` [bytes]. The message ends with
    `remedy`."""
    if needed > (available := available_memory()):
        raise InputError(f"{what} takes {sized(needed)} of memory, of {sized(available)} to spare here; {remedy}")


def available_memory() -> int:
    """Bytes that this process can allocate before the machine swaps or a limit stops it; the machine's whole memory
    where the system does not report what is free."""
    below_limits = [max(0, limit - used) for limit, used in memory_limits().values()]
    return min([_spare(), *below_limits])


def peak_memory() -> int:
    """Peak resident memory of this process [bytes]. Linux's ru_maxrss includes the parent's memory at the time it
    spawned the process; VmHWM does not."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    import resource
    import sys

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def memory_limits() -> dict[str, tuple[int, int]]:
    """Memory limits of this process: {name: (limit, used)} [bytes]."""
    return {**_limit_of_shell(), **_limit_of_container()}


def room_for_arrays() -> int:
    """Bytes available for arrays beside the program itself, before it is loaded; negative if there is too little."""
    below_limits = [
        limit - (_ADDRESSES if name == _SHELL else used + _PROGRAM) for name, (limit, used) in memory_limits().items()
    ]
    return min([_spare() - _PROGRAM, *below_limits])


def require_program() -> None:
    """Raise InputError if a limit is too low for the program itself: drivers abort the process without memory."""
    needed = {_SHELL: (_ADDRESSES, "addresses"), _CONTAINER: (_PROGRAM, "memory")}
    for name, (limit, _) in memory_limits().items():
        least, what = needed[name]
        if limit < least:
            raise InputError(
                f"{name} allows {sized(limit)} of {what}; sonarmap with its libraries and an OpenCL driver needs "
                f"{sized(least)} beside its arrays; raise the limit. 'sonarmap doctor' says what fits"
            )


def _spare() -> int:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        fields = dict(line.split(":", 1) for line in lines)
        return int(fields["MemAvailable"].split()[0]) * 1024
    except (OSError, ValueError, LookupError):  # not Linux
        pass
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # Windows
        return _UNKNOWN


def _limit_of_shell() -> dict[str, tuple[int, int]]:
    """The limit of `ulimit -v`, which counts address space, of which a process uses more than of memory."""
    try:
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit == resource.RLIM_INFINITY:
            return {}
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError, ValueError):  # neither Linux nor macOS
        return {}
    return {"ulimit -v": (limit, used)}


def _limit_of_container() -> dict[str, tuple[int, int]]:
    """The limit of the process's control group (version 2), or within a container of the root group."""
    try:
        lines = _OWN_GROUP.read_text(encoding="ascii").splitlines()
    except (OSError, ValueError):
        return {}
    own = [_GROUPS / line.removeprefix("0::/") for line in lines if line.startswith("0::/")]
    for group in (*own, _GROUPS):
        try:
            limit = int((group / "memory.max").read_text(encoding="ascii"))
            used = int((group / "memory.current").read_text(encoding="ascii")) - _reclaimable(group)
        except (OSError, ValueError):  # there is no limit, or it is "max"
            continue
        return {_CONTAINER: (limit, max(0, used))}
    return {}


def _reclaimable(group: Path) -> int:
    """Bytes of inactive page cache, which memory.current counts but the kernel drops when the group is full."""
    text = (group / "memory.stat").read_text(encoding="ascii")
    match = re.search(r"^inactive_file (\d+)$", text, re.MULTILINE)
    return int(match[1]) if match else 0
