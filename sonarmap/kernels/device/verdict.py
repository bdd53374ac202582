# pyright: strict, reportUnknownMemberType=false
"""Whether a device may be believed: its self-test, run once and remembered by device, driver and kernels."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module

import pyopencl as cl

from sonarmap.kernels.device.cache import digest, recall, remember
from sonarmap.kernels.device.device_info import State
from sonarmap.kernels.device.source import KERNEL_FOLDER, informative_line
from sonarmap.kernels.errors import SonarmapError

# By name: it runs all kernels, which are built on what asks for the verdict.
_CHECKS = "sonarmap.kernels.self_test.checks"
_known: dict[str, "Verdict"] = {}  # of this process, where nothing can be written


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the self-test of a device said; where it failed, what and how far it is off."""

    state: State
    reason: str = ""


def self_test(device: cl.Device) -> Verdict:
    """Test a device in this process, which its driver may end."""
    checks = import_module(_CHECKS)
    try:
        failed = [str(measured) for measured in checks.measure(checks.Device(device)) if not measured.passed]
        reason = "; ".join(failed)
    except (SonarmapError, cl.Error) as error:
        reason = informative_line(str(error))
    return Verdict("failed", reason) if reason else Verdict("passed")


def remembered_verdict(identity: tuple[str, str, str]) -> Verdict:
    """What the last self-test of a device said, with this driver and these kernels."""
    name = memory_name(identity)
    if name in _known:
        return _known[name]
    kept = recall(name)
    state, reason = kept.get("state"), str(kept.get("reason", ""))
    return Verdict(state, reason) if state in ("passed", "failed") else Verdict("not tested")


def remember_verdict(identity: tuple[str, str, str], verdict: Verdict) -> None:
    """Keep what a self-test said, for this process and others."""
    name = memory_name(identity)
    _known[name] = verdict
    remember(name, {"state": verdict.state, "reason": verdict.reason, "device": identity})


def memory_name(identity: tuple[str, str, str]) -> str:
    """What the verdict on this device with this driver and these kernels is remembered by."""
    return f"tested-{digest(*identity, _kernels())}"


@cache
def _kernels() -> str:
    """What tells these kernels from those of another version: their sources."""
    files = sorted(path for suffix in ("*.cl", "*.py") for path in KERNEL_FOLDER.rglob(suffix))
    return digest(*(path.read_text(encoding="utf-8") for path in files))
