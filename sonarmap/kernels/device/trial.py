"""Try each driver and its devices in a separate process, where a crash or a hang does no harm and is reported. Results
are remembered until the machine restarts or the driver changes, those of self-tests until the driver or the kernels
change."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

from sonarmap.kernels.child import LATE, Answers, answer, ask
from sonarmap.kernels.device.cache import LOGGER, digest, recall, remember, require_caches
from sonarmap.kernels.device.device_info import DeviceInfo, State, describe
from sonarmap.kernels.device.drivers import Driver, driver_fault, installed_drivers, load_devices, temporary_folder
from sonarmap.kernels.device.source import informative_line, kernels_digest
from sonarmap.kernels.device.threads import limit_libraries
from sonarmap.kernels.errors import SonarmapError

# Time limits for all devices of a driver; kernels may be compiled on a busy machine.
_SECONDS = 60.0
_SECONDS_OF_TEST = 300.0
_PROBE = "__kernel void probe(__global float8* x) { x[get_global_id(0)] = fma(x[get_global_id(0)], 2.0f, 1.0f); }"
# Prefixes of environment variables that select the devices of drivers.
_VARIABLES = ("CUDA_VISIBLE", "GPU_DEVICE", "HIP_", "LD_", "NVIDIA_", "OCL_ICD_", "ONEAPI_", "POCL_DEV", "ROCR_", "ZE_")
# Imported by name when needed, since it imports all kernels, and kernels import this module.
_CHECKS = "sonarmap.kernels.self_test"
TEST_FAILED = "its self-test failed: "
_FAILED = "the process that tried it failed: "


def try_devices(test: bool = False, again: bool = False) -> list[DeviceInfo]:
    """Try every driver now; arguments and result as of `kernels.device.device.list_devices`."""
    devices: list[list[DeviceInfo]] = []
    for driver in _drivers():
        known = _known(driver) or []
        if again or not any(LATE in info.fault for info in known):  # a hanging driver would take all of its time again
            known = _try(driver)
        if test and any(not info.fault for info in known):
            known = _try(driver, "all")
        devices.append(known)
    return _numbered(devices)


def known_devices() -> list[DeviceInfo]:
    """The devices of each driver as last tried; a driver that was not tried since the machine started is tried now."""
    devices: list[list[DeviceInfo]] = []
    for driver in _drivers():
        known = _known(driver)
        if known is None:
            known = _try(driver)
            for info in known:
                if not info.compute_units:
                    LOGGER.warning(f"the OpenCL driver {driver.file} is not used: {info.fault}")
        devices.append(known)
    return _numbered(devices)


def driver_of(info: DeviceInfo) -> Driver:
    """The driver of a device, by its file."""
    return next((driver for driver in installed_drivers() if driver.file == info.driver_file), Driver())


def run_self_test(info: DeviceInfo) -> tuple[State, str]:
    """Run one device's self-test in another process; remember and return the result and, if it failed, the reason."""
    driver = driver_of(info)
    _try(driver, next(known.selector for known in _known(driver) or [] if known.identity == info.identity))
    return self_test_of(info.identity)


def self_test(device: cl.Device) -> tuple[State, str]:
    """Test a device in this process, which its driver may crash; return the result and, if it failed, the reason."""
    checks = import_module(_CHECKS)
    try:
        failed = [str(measured) for measured in checks.measure(checks.Device(device)) if not measured.passed]
        reason = "; ".join(failed)
    except (SonarmapError, cl.Error) as error:
        reason = informative_line(str(error))
    return ("failed", reason) if reason else ("passed", "")


def self_test_of(identity: tuple[str, str, str]) -> tuple[State, str]:
    """Result and reason of the device's last self-test with this driver and these kernels."""
    kept = recall(_test_name(identity))
    state = kept.get("state")
    return (state, str(kept.get("reason", ""))) if state in ("passed", "failed") else ("not tested", "")


def remember_self_test(identity: tuple[str, str, str], state: State, reason: str = "") -> None:
    """Record the result of a self-test for this process and others."""
    remember(_test_name(identity), {"state": state, "reason": reason, "device": identity})


def main(arguments: Sequence[str]) -> None:
    """In the other process: load one driver and try its devices. The arguments are the driver's file and library, a
    folder for temporary files, the index of the first device to try, and which to self-test: "0:1", "all" or ""."""
    driver, folder, first, tested = Driver(*arguments[:2]), arguments[2], int(arguments[3]), arguments[4]
    nameless = driver.file and not driver.library  # without a library's name the loader would load all others
    platforms = [] if nameless else load_devices(driver, folder)
    devices = {f"{p}:{d}": device for p, listed in enumerate(platforms) for d, device in enumerate(listed)}
    answer(found=[asdict(describe(device, selector)) for selector, device in devices.items()])
    if not devices:
        answer(fault=driver_fault(driver))
    for selector, device in [*devices.items()][first:]:
        answer(begins=selector)
        fault = _fault(device)
        answer(tried=[selector, fault])
        if not fault and tested in (selector, "all"):
            answer(tested=[selector, *self_test(device)])


def _drivers() -> list[Driver]:
    limit_libraries()  # PoCL reads the thread count and the cache folder when its devices are first listed
    require_caches()
    return installed_drivers()


def _try(driver: Driver, tested: str = "") -> list[DeviceInfo]:
    """Try one driver and remember the result; after a device that crashes the process, try the rest in a new one."""
    infos: dict[str, DeviceInfo] = {}
    answers = _ask(driver, infos, 0, tested)
    while answers.end and answers.named("begins"):
        last = answers.named("begins")[-1]
        _blame(infos, last, answers, tested)
        first = [*infos].index(last) + 1
        if first == len(infos):
            break
        answers = _ask(driver, infos, first, tested)
    again = "; 'sonarmap devices --test' tries it once more" if LATE in answers.end else ""
    fault = f"{_FAILED}{answers.end}{again}" if answers.end else "".join(answers.named("fault"))
    if fault and not infos:
        name = Path(driver.file).name or "the system's loader"
        infos["0"] = DeviceInfo("0", name, fault=fault, driver_file=driver.file)
    devices = [asdict(info) for info in infos.values()]
    remember(_trial_name(driver), {"digest": _digest(driver, devices), "devices": devices})
    return [*infos.values()]


def _ask(driver: Driver, infos: dict[str, DeviceInfo], first: int, tested: str) -> Answers:
    """Try the devices from index `first` on in a new process, and add the results to `infos`."""
    seconds = _SECONDS_OF_TEST if tested else _SECONDS
    with temporary_folder() as folder:
        answers = ask(__name__, driver.file, driver.library, folder, str(first), tested, seconds=seconds)
    more = {"driver_file": driver.file, "fault": "its driver failed before it was tried"}
    for entry in chain.from_iterable(answers.named("found")):
        infos.setdefault(entry["selector"], DeviceInfo(**entry | more))
    for selector, fault in answers.named("tried"):
        infos[selector] = replace(infos[selector], fault=fault)
    for selector, state, reason in answers.named("tested"):
        remember_self_test(infos[selector].identity, state, reason)
    return answers


def _blame(infos: dict[str, DeviceInfo], last: str, answers: Answers, tested: str) -> None:
    """Record a fault of the device during whose trial or test the process ended; ending after both is no fault."""
    reason = f"{_FAILED}{answers.end}"
    faults = dict(answers.named("tried"))
    done = [selector for selector, *_ in answers.named("tested")]
    if last not in faults:
        infos[last] = replace(infos[last], fault=reason)
    elif not faults[last] and tested in (last, "all") and last not in done:
        remember_self_test(infos[last].identity, "failed", reason)


def _known(driver: Driver) -> list[DeviceInfo] | None:
    """The devices of the last trial; None if the machine has restarted or the driver has changed since."""
    kept = recall(_trial_name(driver))
    devices = kept.get("devices")
    if devices is None or kept.get("digest") != _digest(driver, devices):
        return None
    return [DeviceInfo(**entry) for entry in devices]


def _trial_name(driver: Driver) -> str:
    variables = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(_VARIABLES))
    return f"driver-{digest(driver.file, driver.library, *variables)}"


def _test_name(identity: tuple[str, str, str]) -> str:
    return f"tested-{digest(*identity, kernels_digest())}"


def _digest(driver: Driver, devices: Any) -> str:
    """Digest of the devices and of what they depend on: the driver's files, the system's boot, the nodes of GPUs."""
    changes = [str(_changed(Path(path))) for path in (driver.file, driver.library, "/etc/ld.so.cache")]
    nodes = sorted(str(node) for kind in ("nvidia*", "dri/*", "kfd") for node in Path("/dev").glob(kind))
    try:
        start = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
    except OSError:  # not Linux
        start = ""
    return digest(start, *changes, *nodes, json.dumps(devices))


def _changed(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _numbered(devices: list[list[DeviceInfo]]) -> list[DeviceInfo]:
    """The devices of all drivers, with platforms numbered over all drivers, and with the results of self-tests."""
    infos: list[DeviceInfo] = []
    before = 0
    for of_driver in devices:
        places = [info.selector.partition(":") for info in of_driver]
        for info, (platform, colon, device) in zip(of_driver, places, strict=True):
            state, reason = self_test_of(info.identity)
            fault = info.fault or (f"{TEST_FAILED}{reason}" if state == "failed" else "")
            selector = f"{before + int(platform)}{colon}{device}"
            infos.append(replace(info, selector=selector, fault=fault, self_test=state))
        before += max((int(platform) + 1 for platform, *_ in places), default=0)
    return infos


def _fault(device: cl.Device) -> str:
    """Run a small kernel and check its result; return what went wrong, or ""."""
    try:
        context = cl.Context([device])
        queue = cl.CommandQueue(context)
        program = cl.Program(context, _PROBE).build()
        numbers = np.arange(64, dtype=np.float32)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        buffer = cl.Buffer(context, flags, hostbuf=numbers)
        cl.Kernel(program, "probe")(queue, (8,), (1,), buffer)
        result = np.empty_like(numbers)
        cl.enqueue_copy(queue, result, buffer)
        return "" if np.array_equal(result, 2 * numbers + 1) else "a trial kernel gave wrong numbers"
    except cl.Error as error:
        return informative_line(str(error))
