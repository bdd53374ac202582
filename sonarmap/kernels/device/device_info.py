"""Descriptions of OpenCL devices, which need no loaded driver, and the choice among them by selector and preference."""

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
    """An OpenCL device, or a driver without devices, as `list_devices` returns it.

    Attributes:
        selector: "platform:device", which `choose_device` takes; the number of a driver without devices.
        name, platform, version, kind: as the driver reports them; kind is "cpu", "gpu" or "other".
        compute_units: number of cores or multiprocessors; 0 for a driver without devices.
        memory, largest_allocation: [bytes].
        fault: why it cannot be used, or "" if a trial kernel gave the right numbers and no self-test failed.
        self_test: "passed", "failed" or "not tested", with this driver and these kernels (`kernels.self_test`).
        driver_file: the .icd file that names its driver; "" if the system's loader found the driver.
        vendor, platform_version, driver_version: as the driver reports them.
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
        """Name, platform version and driver version: equal only for identical devices with the same driver."""
        return self.name, self.platform_version, self.driver_version


def describe(device: cl.Device, selector: str) -> DeviceInfo:
    """The properties that a device reports; it is not tried."""
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
    """The device's `DeviceInfo.identity`."""
    return device.name.strip(), device.platform.version.strip(), device.driver_version.strip()


def kind(device: cl.Device) -> str:
    """ "gpu", "cpu" or "other"."""
    if device.type & cl.device_type.GPU:
        return "gpu"
    return "cpu" if device.type & cl.device_type.CPU else "other"


def matching(wanted: str, infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices that match a selector of `kernels.device.device.choose_device`."""
    text = wanted.strip().lower()
    if re.fullmatch(r"[^:]+:\s*\d+(\s*,\s*\d+)+", text):  # for PyOpenCL a context of several devices
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

    GPUs with their own memory come first, then those with more compute units times clock. This ranks GPUs of one maker
    well, but those of different makers only roughly, as their units differ in size. CPU drivers of one vendor are
    ordered newest first, since an old PoCL does not know a new processor. Versions of different vendors are not
    comparable: vendors, and all other devices, keep the order in which the system lists them.
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
    names = (f"{info.selector} {info.name}" + (f" ({info.platform})" if info.platform else "") for info in infos)
    return f"There are: {'; '.join(names)}"


def _at_place(text: str, infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices that match "platform:device", each a number or part of a name, or a platform's number alone."""
    platform, colon, device = (part.strip() for part in text.partition(":"))
    if not platform or not (colon or platform.isdecimal()):
        return []
    device = device or "0"  # as in PyOpenCL
    matches: list[DeviceInfo] = []
    for info in infos:
        p, _, d = info.selector.partition(":")
        there = platform == p if platform.isdecimal() else platform in _platform_words(info)
        if there and (device == (d or "0") if device.isdecimal() else device in info.name.lower()):
            matches.append(info)
    return matches


def _is_named(text: str, info: DeviceInfo) -> bool:
    """Whether a text is part of the device's or its platform's name or version; a number matches whole numbers."""
    if text.isdecimal():
        return re.search(rf"(?<!\d){text}(?!\d)", info.name) is not None
    return text in f"{info.name} {info.version}".lower() or text in _platform_words(info)


def _platform_words(info: DeviceInfo) -> str:
    return f"{info.platform} {info.platform_version}".lower()


def _driver_age(info: DeviceInfo) -> tuple[list[int], bool]:
    """Sort key: old drivers before new ones, and a release candidate before its release."""
    version = info.driver_version
    digits = re.search(r"\d+(\.\d+)*", version)
    return [int(part) for part in digits[0].split(".")] if digits else [], "rc" not in version.lower()
