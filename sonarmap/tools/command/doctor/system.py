"""Cores, limits of the system, and text: what this process is given."""

import codecs
import locale
import os
import sys
from pathlib import Path

from sonarmap.tools.command.doctor.finding import Finding, Remedy

_FILES = 256  # that are open at once: recordings, journal, workers' pipes
_BUFFER = Path("/proc/sys/net/core/rmem_max")


def cores() -> Finding:
    """How many cores this process may use."""
    from sonarmap.kernels.device.threads import VARIABLE, thread_count
    from sonarmap.kernels.errors import InputError

    there = os.cpu_count() or 1
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else there
    details = {"machine": there, "affinity": bound}
    try:
        used = thread_count()
    except InputError as error:
        return Finding("cores", "wrong", str(error), (Remedy("use all cores:", f"unset {VARIABLE}"),), details)
    seen = f"{used} of {there} used" if used < there else f"{there}, all used"
    seen += f"; bound to {bound} (taskset)" if bound < there else ""
    seen += f"; {VARIABLE}={os.environ[VARIABLE]}" if VARIABLE in os.environ else ""
    return Finding("cores", "ok", seen, details=details | {"used": used})


def open_files() -> Finding:
    """How many files may be open at once."""
    try:
        import resource
    except ImportError:  # Windows
        return Finding("open files", "ok", "no limit is known")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    endless = resource.RLIM_INFINITY
    details = {"limit": None if soft == endless else soft, "hard limit": None if hard == endless else hard}
    if soft == endless or soft >= _FILES:
        return Finding("open files", "ok", "no limit" if soft == endless else f"up to {soft:,}", details=details)
    most = 4096 if hard == endless else min(4096, hard)
    seen = f"up to {soft:,}; many recordings or workers need {_FILES}"
    return Finding("open files", "warning", seen, (Remedy("allow more:", f"ulimit -n {most}"),), details)


def receive_buffer() -> Finding:
    """What the system holds of a sonar's packets while the disk is busy (`sonarmap record`)."""
    from sonarmap.tools.command.record.source import WANTED_BUFFER

    try:
        most = int(_BUFFER.read_text(encoding="ascii"))
    except (OSError, ValueError):  # not Linux, or a container that does not show it
        return Finding("network", "ok", "the receive buffer's limit is not known here", details={"rmem_max": None})
    details = {"rmem_max": most, "wanted": WANTED_BUFFER}
    if most >= WANTED_BUFFER:
        return Finding(
            "network", "ok", f"receive buffer up to {most / 2**20:.0f} MiB, as `record` wants", details=details
        )
    # A system's own limit is always lower, and enough as long as the computer keeps up: `record` says if it was not.
    seen = f"receive buffer up to {most / 1024:.0f} KiB; should `record` lose packets:"
    command = f"sudo sysctl -w net.core.rmem_max={WANTED_BUFFER}"
    return Finding("network", "ok", f"{seen} {command}", details=details)


def encoding() -> Finding:
    """Whether file names and what is printed can hold every letter."""
    used = {
        "locale": locale.getpreferredencoding(False),
        "file names": sys.getfilesystemencoding(),
        "output": getattr(sys.stdout, "encoding", None) or "utf-8",
    }
    other = {name: coding for name, coding in used.items() if not _is_utf8(coding)}
    if not other:
        return Finding("text", "ok", "UTF-8", details=used)
    seen = ", ".join(f"{name} {coding}" for name, coding in other.items())
    remedy = Remedy("letters such as ø or ° may be lost; use UTF-8:", "export PYTHONUTF8=1")
    return Finding("text", "warning", seen, (remedy,), used)


def _is_utf8(coding: str) -> bool:
    try:
        return codecs.lookup(coding).name == "utf-8"
    except LookupError:
        return False
