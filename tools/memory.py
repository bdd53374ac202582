"""How much memory this machine has to spare, asked before much of it is taken."""

import os
from pathlib import Path

from kernels.errors import InputError

_UNKNOWN = 4 << 30  # taken where the system does not say


def require_memory(what: str, needed: int, remedy: str) -> None:
    """Refuse what this machine's memory cannot hold.

    Args:
        what: that needs memory, in words.
        needed: how much [bytes].
        remedy: what to do instead, in words.

    Raises:
        InputError: it needs more than `available_memory`.
    """
    if needed > (available := available_memory()):
        raise InputError(
            f"{what} takes {in_gib(needed)} of memory, and this machine has {in_gib(available)} to spare; {remedy}"
        )


def available_memory() -> int:
    """What can be taken before the machine swaps [bytes]; all of its memory where the system says no more."""
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


def in_gib(size: int) -> str:
    """Bytes in words; of any number of digits."""
    return f"{size // 2**30:,} GiB" if size >= 10 * 2**30 else f"{size / 2**30:.2g} GiB"
