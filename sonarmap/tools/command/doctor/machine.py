"""What this process is given: memory and the largest grid that fits in it, and cores."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonarmap.tools.command.doctor.finding import Finding, Remedy, Verdict, size

if TYPE_CHECKING:
    from sonarmap.kernels.child import Answers

_USUAL_EDGE = 128  # of --grid
_LESS = Remedy("end other programs, or give the machine or its control group (container) more memory")


def memory(answers: "Answers | None") -> Finding:
    """Whether the usual grid fits, and which is the largest that does, by what the check of OpenCL said of the device
    and its plan; None where it could not."""
    from sonarmap.tools.files.memory import available_memory, memory_limits, room_for_arrays

    room, total = room_for_arrays(), _total()
    limits = {name: limit for name, (limit, _) in memory_limits().items()}
    seen = [f"{size(available_memory())} to spare" + (f" of {size(total)}" if total else "")]
    seen += [f"{name} allows {size(limit)}" for name, limit in limits.items()]
    fits, said, details = _grids(answers, room)
    details |= {"available": available_memory(), "total": total or None, "limits": limits}
    verdict: Verdict = "ok" if fits is None or fits >= _USUAL_EDGE else "warning" if fits else "wrong"
    if room < 0:
        verdict, said = "wrong", ["too little for sonarmap with its libraries and an OpenCL driver"]
    raised = "raise the limit:" if room < 0 else "raise the limit, or use a smaller --grid:"
    remedy = Remedy(raised, "ulimit -v unlimited") if "ulimit -v" in limits else _LESS
    return Finding(verdict, "; ".join([*seen, *said]), () if verdict == "ok" else (remedy,), details)


def memory_is_short() -> bool:
    """Whether a limit, or what other programs take, leaves too little for sonarmap itself: then anything may fail."""
    from sonarmap.tools.files.memory import room_for_arrays

    return room_for_arrays() < 0


def _grids(answers: "Answers | None", room: int) -> tuple[int | None, list[str], dict[str, Any]]:
    """The largest grid that fits, 0 for none, None where no device says; what to say of it; and for programs."""
    if answers is None or not answers.named("pairs"):
        return None, [], {"largest grid": None}
    pairs = dict(answers.named("pairs")[0])
    shared, of_device = answers.named("shared")[0], answers.named("device_memory")[0]
    held = [
        edge for edge in pairs if edge <= (answers.named("largest")[0] or 0) and (not shared or pairs[edge] <= room)
    ]
    fits = max(held, default=0)
    said = [] if shared else [f"{size(of_device)} on the device"]
    said.append(f"--grid up to {fits}, {size(pairs[fits])} for a pair" if fits else "no grid fits")
    return fits, said, {"largest grid": fits or None, "device": of_device, "shared": shared}


def _total() -> int:
    """All of this machine's memory [bytes]; 0 where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return int(next(line for line in lines if line.startswith("MemTotal")).split()[1]) * 1024
    except (OSError, ValueError, LookupError, StopIteration):
        return 0


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
        return Finding("wrong", str(error), (Remedy("use all cores:", f"unset {VARIABLE}"),), details)
    seen = f"{used} of {there} used" if used < there else f"{there}, all used"
    seen += f"; bound to {bound} (taskset)" if bound < there else ""
    seen += f"; {VARIABLE}={os.environ[VARIABLE]}" if VARIABLE in os.environ else ""
    return Finding("ok", seen, details=details | {"used": used})
