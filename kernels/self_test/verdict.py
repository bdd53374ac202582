# pyright: strict, reportUnknownMemberType=false
"""Whether a device may be believed: its self-test, run once and remembered by device, driver and kernels."""

import os
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Literal

import pyopencl as cl

from kernels.device.cache import LOGGER, digest, recall, remember
from kernels.device.compiled import identity
from kernels.device.source import KERNEL_FOLDER, informative_line
from kernels.errors import SonarmapError

State = Literal["passed", "failed", "not tested"]
_CHECKS = "kernels.self_test.checks"  # by name: it runs all kernels, which are built on what asks for the verdict
_known: dict[str, "Verdict"] = {}  # of this process, where nothing can be written
_BEGUN = "begun"  # what is remembered while a test runs: a driver can take the whole process with it


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the self-test of a device said.

    Attributes:
        state: "passed", "failed" or "not tested".
        reason: what failed and how far it is off; "" where it passed or was not tested.
    """

    state: State
    reason: str = ""


def remembered_verdict(device: cl.Device) -> Verdict:
    """What the last self-test of this device said, with this driver and these kernels."""
    name = memory_name(device)
    if name in _known:
        return _known[name]
    kept = recall(name)
    state, reason = kept.get("state"), str(kept.get("reason", ""))
    if state == _BEGUN:
        # another process may be at it right now
        running = _is_running(kept.get("process"))
        return (
            Verdict("not tested") if running else Verdict("failed", "its test did not end: the driver crashed or hung")
        )
    if state in ("passed", "failed"):
        return Verdict(state, reason)
    return Verdict("not tested")


def run_self_test(device: cl.Device) -> Verdict:
    """Test a device now, and remember what came out."""
    checks = import_module(_CHECKS)
    name, about = memory_name(device), {"device": identity(device)}
    remember(name, {"state": _BEGUN, "process": os.getpid(), **about})
    try:
        failed = [str(measured) for measured in checks.measure(checks.Device(device)) if not measured.passed]
        reason = "; ".join(failed)
    except (SonarmapError, cl.Error) as error:
        reason = informative_line(str(error))
    except BaseException:  # stopped by the user, or a defect: nothing is known of the device
        remember(name, {})
        raise
    verdict = Verdict("failed", reason) if reason else Verdict("passed")
    _known[name] = verdict
    remember(name, {"state": verdict.state, "reason": verdict.reason, **about})
    return verdict


def believed(device: cl.Device) -> Verdict:
    """The verdict on a device, which is tested now if it never was."""
    verdict = remembered_verdict(device)
    if verdict.state != "not tested":
        return verdict
    name = device.name.strip()
    LOGGER.info(f"testing {name} before it is used for the first time with this driver: this takes some seconds")
    return run_self_test(device)


def memory_name(device: cl.Device) -> str:
    """What the verdict on this device with this driver and these kernels is remembered by."""
    return f"tested-{digest(*identity(device), _kernels())}"


@cache
def _kernels() -> str:
    """What tells these kernels from those of another version: their sources."""
    files = sorted(path for suffix in ("*.cl", "*.py") for path in KERNEL_FOLDER.rglob(suffix))
    return digest(*(path.read_text(encoding="utf-8") for path in files))


def _is_running(process: object) -> bool:
    if not isinstance(process, int) or os.name != "posix":
        return False
    try:
        os.kill(process, 0)
    except OSError:
        return False
    return True
