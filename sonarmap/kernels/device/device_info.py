"""What is known of OpenCL devices without their drivers in this process, and which of them a selector means."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import pyopencl as cl

from sonarmap.kernels.errors import DeviceError

_KINDS = ("gpu", "cpu", "other")
State = Literal["passed", "failed", "not tested"]


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """One OpenCL device, or a driver that came to no device, as `list_devices` finds it.

    Attributes:
        selector: what `choose_device` takes to choose it, "platform:device"; of a driver without devices its number.
        name, platform, version, kind: as the driver gives them; kind is "cpu", "gpu" or "other".
        compute_units: number of cores or multiprocessors; 0 of a driver without devices.
        memory, largest_allocation: [bytes].
        fault: why it cannot be used, or "" where a trial kernel ran and gave the right numbers, and no test failed.
        self_test: "passed", "failed" or "not tested", with this driver and these kernels (`kernels.self_test`).
        driver_file: what names its driver, a file .icd; "" where the loader found it by itself.
        vendor, platform_version, driver_version: as the driver gives them.
        clock: [MHz].
        shares_memory: whether its memory is the host's.
    """

    selector: str
    name: str
    platform: str = ""
    version: str = ""
    kind: str = "other"
    compute_units: int = 0
    memory: int = 0
    largest_allocation: int = 0
    fault: str = ""
    self_test: State = "not tested"
    driver_file: str = ""
    vendor: str = ""
    platform_version: str = ""
    driver_version: str = ""
    clock: int = 0
    shares_memory: bool = False

    @property
    def identity(self) -> tuple[str, str, str]:
        """What tells a device with its driver from others: name, platform, driver."""
        return self.name, self.platform_version, self.driver_version


def describe(device: cl.Device, selector: str) -> DeviceInfo:
    """What a device says of itself; it is not tried."""
    platform = device.platform
    return DeviceInfo(
        selector=selector,
        name=device.name.strip(),
        platform=platform.name.strip(),
        version=f"{device.version.strip()}, driver {device.driver_version.strip()}",
        kind=kind(device),
        compute_units=device.max_compute_units,
        memory=device.global_mem_size,
        largest_allocation=device.max_mem_alloc_size,
        vendor=platform.vendor.strip(),
        platform_version=platform.version.strip(),
        driver_version=device.driver_version.strip(),
        clock=device.max_clock_frequency,
        shares_memory=bool(device.host_unified_memory),
    )


def identity(device: cl.Device) -> tuple[str, str, str]:
    """As `DeviceInfo.identity`."""
    return device.name.strip(), device.platform.version.strip(), device.driver_version.strip()


def kind(device: cl.Device) -> str:
    """ "gpu", "cpu" or "other"."""
    if device.type & cl.device_type.GPU:
        return "gpu"
    return "cpu" if device.type & cl.device_type.CPU else "other"


def matching(wanted: str, infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices that a selector means; as `kernels.device.device.choose_device` reads it."""
    text = wanted.strip().lower()
    if re.fullmatch(r"[^:]+:\s*\d+(\s*,\s*\d+)+", text):  # PyOpenCL takes this for a context of several
        first = wanted.partition(",")[0].strip()
        raise DeviceError(f"'{wanted}' names several OpenCL devices; choose one, as in '{first}'. {_listed(infos)}")
    if not text:
        return infos
    if text in _KINDS:
        matches = [info for info in infos if info.kind == text]
    else:
        matches = _at_place(text, infos) or [info for info in infos if _is_named(text, info)]
    if not matches:
        raise DeviceError(f"no OpenCL device matches '{wanted}'. {_listed(infos)}")
    return matches


def by_preference(infos: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """GPUs, then CPUs, then others.

    Of GPUs, those with their own memory come first, then those with more compute units times clock. That counts
    a maker's GPUs well and compares those of two makers roughly: what one calls a unit is several of another's.
    Of CPUs, the drivers of one vendor come newest first, since an old PoCL does not know a new processor. Versions of
    different vendors do not compare: their order, and that of all else, is the one in which the system lists them.
    """
    infos = list(infos)
    vendors = list(dict.fromkeys(info.vendor for info in infos))
    cpus = [info for info in infos if info.kind == "cpu"]
    cpus.sort(key=_driver_age, reverse=True)
    cpus.sort(key=lambda info: vendors.index(info.vendor))
    gpus = [info for info in infos if info.kind == "gpu"]
    gpus.sort(key=lambda info: (info.shares_memory, -info.compute_units * info.clock))
    return gpus + cpus + [info for info in infos if info.kind == "other"]


def _listed(infos: list[DeviceInfo]) -> str:
    known = (f"{info.selector} {info.name}" + (f" ({info.platform})" if info.platform else "") for info in infos)
    return f"There are: {'; '.join(known)}"


def _at_place(text: str, infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices of "platform:device", each a number or a part of a name, or of a platform's number alone."""
    platform, colon, device = (part.strip() for part in text.partition(":"))
    if not platform or not (colon or platform.isdecimal()):
        return []
    device = device or "0"  # as PyOpenCL takes it
    matches: list[DeviceInfo] = []
    for info in infos:
        p, _, d = info.selector.partition(":")
        there = platform == p if platform.isdecimal() else platform in _platform_words(info)
        if there and (device == (d or "0") if device.isdecimal() else device in info.name.lower()):
            matches.append(info)
    return matches


def _is_named(text: str, info: DeviceInfo) -> bool:
    """Whether a text is part of the device's or its platform's name or version; digits count as a whole number."""
    if text.isdecimal():
        return re.search(rf"(?<!\d){text}(?!\d)", info.name) is not None
    return text in f"{info.name} {info.version}".lower() or text in _platform_words(info)


def _platform_words(info: DeviceInfo) -> str:
    return f"{info.platform} {info.platform_version}".lower()


def _driver_age(info: DeviceInfo) -> tuple[list[int], bool]:
    """Sorts old drivers before new ones, and a release candidate before the release."""
    version = info.driver_version
    digits = re.search(r"\d+(\.\d+)*", version)
    return [int(part) for part in digits[0].split(".")] if digits else [], "rc" not in version.lower()
