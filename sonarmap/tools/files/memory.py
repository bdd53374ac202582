"""How much memory this machine has to spare, asked before much of it is taken."""

import os
import re
from pathlib import Path

from sonarmap.kernels.counted import sized
from sonarmap.kernels.errors import InputError

_UNKNOWN = 4 << 30  # taken where the system does not say
_GROUPS, _OWN_GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
_SHELL, _CONTAINER = "ulimit -v", "the control group"
# Measured: what the program takes with its libraries, the OpenCL driver and its compiler, beside the arrays of a grid
# [bytes]: of memory, and of addresses, which `ulimit -v` counts.
_PROGRAM, _ADDRESSES = 400 << 20, 1400 << 20


def require_memory(what: str, needed: int, remedy: str) -> None:
    """Refuse `what`, if it takes more than this machine's memory can hold (`available_memory`); `needed` [bytes]. The
    InputError says its `remedy`."""
    if needed > (available := available_memory()):
        raise InputError(
            f"{what} takes {sized(needed)} of memory, and this machine has {sized(available)} to spare; {remedy}"
        )


def available_memory() -> int:
    """What this process can take before the machine swaps or a limit stops it [bytes]; all of the machine's memory
    where the system says no more."""
    left = [max(0, limit - used) for limit, used in memory_limits().values()]
    return min([_spare(), *left])


def peak_memory() -> int:
    """The most memory that this process had resident since it began [bytes]. Linux's ru_maxrss starts with what the
    parent held when it spawned the process; VmHWM does not."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    import resource
    import sys

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def memory_limits() -> dict[str, tuple[int, int]]:
    """What holds this process below the machine's memory: of each limit its name, where it is, and what is used."""
    return {**_limit_of_shell(), **_limit_of_container()}


def room_for_arrays() -> int:
    """What memory and limits leave beside the program itself, before it is loaded [bytes]; below 0: too little."""
    left = [
        limit - (_ADDRESSES if name == _SHELL else used + _PROGRAM) for name, (limit, used) in memory_limits().items()
    ]
    return min([_spare() - _PROGRAM, *left])


def require_program() -> None:
    """Refuse a limit in which the program itself does not fit: drivers end the whole process where memory ends."""
    needed = {_SHELL: (_ADDRESSES, "addresses"), _CONTAINER: (_PROGRAM, "memory")}
    for name, (limit, _) in memory_limits().items():
        least, what = needed[name]
        if limit < least:
            raise InputError(
                f"{name} allows {sized(limit)} of {what}, and sonarmap with its libraries and an OpenCL driver needs "
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
    """`ulimit -v`, of addresses: more of them are used than memory."""
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
    """Of a control group of version 2, as containers have it: of this process, or, within a container, the top."""
    try:
        lines = _OWN_GROUP.read_text(encoding="ascii").splitlines()
    except (OSError, ValueError):
        return {}
    own = [_GROUPS / line.removeprefix("0::/") for line in lines if line.startswith("0::/")]
    for group in (*own, _GROUPS):
        try:
            limit = int((group / "memory.max").read_text(encoding="ascii"))
            taken = int((group / "memory.current").read_text(encoding="ascii")) - _given_back(group)
        except (OSError, ValueError):  # there is none, or it says "max"
            continue
        return {_CONTAINER: (limit, max(0, taken))}
    return {}


def _given_back(group: Path) -> int:
    """The files in memory that a full group drops first, which its usage counts in [bytes]."""
    text = (group / "memory.stat").read_text(encoding="ascii")
    match = re.search(r"^inactive_file (\d+)$", text, re.MULTILINE)
    return int(match[1]) if match else 0
