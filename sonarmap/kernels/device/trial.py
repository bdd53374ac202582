# pyright: strict, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Every driver and its devices are tried in a process of their own: one that crashes or hangs is named, and harms
nothing. What came out is remembered until the machine starts anew, or its drivers change."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

from sonarmap.kernels.child import LATE, Answers, answer, ask
from sonarmap.kernels.device.cache import LOGGER, digest, recall, remember, require_caches
from sonarmap.kernels.device.device_info import DeviceInfo, describe
from sonarmap.kernels.device.drivers import Driver, driver_fault, installed_drivers
from sonarmap.kernels.device.loaded import load_devices, temporary_folder
from sonarmap.kernels.device.source import informative_line
from sonarmap.kernels.device.threads import limit_libraries
from sonarmap.kernels.device.verdict import Verdict, remember_verdict, remembered_verdict, self_test

_SECONDS, _SECONDS_OF_TEST = 60.0, 300.0  # for all devices of a driver; kernels may be compiled on a busy machine
_PROBE = "__kernel void probe(__global float8* x) { x[get_global_id(0)] = fma(x[get_global_id(0)], 2.0f, 1.0f); }"
# Variables that say which devices a driver shows, by how they begin.
_VARIABLES = ("CUDA_VISIBLE", "GPU_DEVICE", "HIP_", "LD_", "NVIDIA_", "OCL_ICD_", "ONEAPI_", "POCL_DEV", "ROCR_", "ZE_")
TEST_FAILED = "its self-test failed: "
_FAILED = "the process that tried it failed: "
_tried: dict[str, list[DeviceInfo]] = {}  # what is known to this process
_recalled: set[str] = set()  # of these, what another process found


def try_devices(test: bool = False, again: bool = False) -> list[DeviceInfo]:
    """Try every driver now, as `kernels.device.device.list_devices` says."""
    drivers = _drivers()
    for driver in drivers:
        if again or not (_is_known(driver, remembered=True) and _hung(driver)):
            _try(driver)
        if test and any(not info.fault for info in _tried[_memory_name(driver)]):
            _try(driver, "all")
    return _numbered(drivers)


def known_devices(remembered: bool = True) -> list[DeviceInfo]:
    """What the last trial of each driver said; one that this machine has not tried since it started is tried now.

    A trial by another process counts only where `remembered`.
    """
    drivers = _drivers()
    for driver in drivers:
        if _is_known(driver, remembered):
            continue
        _try(driver)
        for info in _tried[_memory_name(driver)]:
            if not info.compute_units:
                LOGGER.warning(f"the OpenCL driver {driver.file} is not used: {info.fault}")
    return _numbered(drivers)


def run_self_test(info: DeviceInfo) -> None:
    """Run one device's self-test, and remember its verdict."""
    driver = driver_of(info)
    _try(driver, next(each.selector for each in _tried[_memory_name(driver)] if each.identity == info.identity))


def driver_of(info: DeviceInfo) -> Driver:
    """The driver of a device."""
    return next((driver for driver in installed_drivers() if driver.file == info.driver_file), Driver())


def main(arguments: Sequence[str]) -> None:
    """In the other process: load one driver, and try its devices.

    Args:
        arguments: the driver's file and library; a folder for temporary files; the first device to try; whose
            self-test to run, as "0:1" or "all".
    """
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
            verdict = self_test(device)
            answer(tested=[selector, verdict.state, verdict.reason])


def _drivers() -> list[Driver]:
    limit_libraries()  # PoCL reads its number when its devices are asked for first, and where to write
    require_caches()
    return installed_drivers()


def _try(driver: Driver, tested: str = "") -> None:
    """Try one driver, and remember what came out; after a device that ends the process, the rest in a new one."""
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
    _keep(driver, [*infos.values()])


def _ask(driver: Driver, infos: dict[str, DeviceInfo], first: int, tested: str) -> Answers:
    """Have a process try the devices from `first` on, and add to `infos` what it says of each."""
    seconds = _SECONDS_OF_TEST if tested else _SECONDS
    with temporary_folder() as folder:
        answers = ask(__name__, driver.file, driver.library, folder, str(first), tested, seconds=seconds)
    more = {"driver_file": driver.file, "fault": "its driver failed before it was tried"}
    for entry in chain.from_iterable(answers.named("found")):
        infos.setdefault(entry["selector"], DeviceInfo(**entry | more))
    for selector, fault in answers.named("tried"):
        infos[selector] = replace(infos[selector], fault=fault)
    for selector, state, reason in answers.named("tested"):
        remember_verdict(infos[selector].identity, Verdict(state, reason))
    return answers


def _blame(infos: dict[str, DeviceInfo], last: str, answers: Answers, tested: str) -> None:
    """Say what is wrong with the device at which the process ended; an end when all is done harms nothing."""
    reason = f"{_FAILED}{answers.end}"
    faults = dict(answers.named("tried"))
    done = [selector for selector, *_ in answers.named("tested")]
    if last not in faults:
        infos[last] = replace(infos[last], fault=reason)
    elif not faults[last] and tested in (last, "all") and last not in done:
        remember_verdict(infos[last].identity, Verdict("failed", reason))


def _keep(driver: Driver, infos: list[DeviceInfo]) -> None:
    name, devices = _memory_name(driver), [asdict(info) for info in infos]
    _tried[name] = infos
    _recalled.discard(name)
    remember(name, {"digest": _digest(driver, devices), "devices": devices})


def _is_known(driver: Driver, remembered: bool) -> bool:
    """Whether a trial is known, perhaps by another process since the machine started and its drivers changed."""
    name = _memory_name(driver)
    if name in _tried and (remembered or name not in _recalled or _hung(driver)):
        return True
    content = recall(name) if remembered else {}
    devices = content.get("devices")
    if devices is None or content.get("digest") != _digest(driver, devices):
        return False
    _tried[name] = [DeviceInfo(**entry) for entry in devices]
    _recalled.add(name)
    return True


def _hung(driver: Driver) -> bool:
    """Whether a driver that was tried did not answer: each trial would take all of its time again."""
    return any(LATE in info.fault for info in _tried[_memory_name(driver)])


def _memory_name(driver: Driver) -> str:
    variables = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(_VARIABLES))
    return f"driver-{digest(driver.file, driver.library, *variables)}"


def _digest(driver: Driver, devices: Any) -> str:
    """Of what was found, and of what it depends on: the driver's files, the kernel that runs, the nodes of GPUs."""
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


def _numbered(drivers: list[Driver]) -> list[DeviceInfo]:
    """Platforms counted over all drivers, and what self-tests said."""
    infos: list[DeviceInfo] = []
    before = 0
    for of_driver in [_tried[_memory_name(driver)] for driver in drivers]:
        places = [info.selector.partition(":") for info in of_driver]
        for info, (platform, colon, device) in zip(of_driver, places, strict=True):
            verdict = remembered_verdict(info.identity)
            fault = info.fault or (f"{TEST_FAILED}{verdict.reason}" if verdict.state == "failed" else "")
            selector = f"{before + int(platform)}{colon}{device}"
            infos.append(replace(info, selector=selector, fault=fault, self_test=verdict.state))
        before += max((int(platform) + 1 for platform, *_ in places), default=0)
    return infos


def _fault(device: cl.Device) -> str:
    """Run a small kernel and look at its numbers; say in a few words what went wrong, or nothing."""
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
