# pyright: strict
"""What is known of an OpenCL device without its driver in this process."""

from dataclasses import dataclass
from typing import Literal

import pyopencl as cl

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


def kind(device: cl.Device) -> str:
    """ "gpu", "cpu" or "other"."""
    if device.type & cl.device_type.GPU:
        return "gpu"
    return "cpu" if device.type & cl.device_type.CPU else "other"
