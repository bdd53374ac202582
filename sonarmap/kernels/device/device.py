"""Choose and list OpenCL devices, build programs once, and check memory before allocation.

A forked process must not inherit an OpenCL context: spawn workers, and create a `Device` in each.
"""

import os
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache, cached_property
from math import prod
from typing import Literal

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from pyopencl.array import Array

from sonarmap.kernels.device.cache import LOGGER
from sonarmap.kernels.device.device_info import DeviceInfo, by_preference, identity, kind, matching
from sonarmap.kernels.device.drivers import load_devices, loaded_driver, refuse_fork
from sonarmap.kernels.device.source import KERNEL_FOLDER, compile_program, literal
from sonarmap.kernels.device.trial import TEST_FAILED, driver_of, known_devices, run_self_test, try_devices
from sonarmap.kernels.errors import DeviceError, InputError

__all__ = ["Array", "Device", "DeviceInfo", "choose_device", "list_devices"]

NO_PLATFORM = (
    "no OpenCL driver was found. For processors: 'sudo apt install pocl-opencl-icd', or without root "
    "'pip install intel-opencl-rt intel-cmplr-lib-rt'; a GPU's comes with the GPU. "
    "'sonarmap doctor' says where drivers were looked for."
)
_DRIVER_REMEDY = (
    ". For processors 'sudo apt install pocl-opencl-icd' brings a driver that works, and without root "
    "'pip install intel-opencl-rt intel-cmplr-lib-rt'. 'sonarmap doctor' says more."
)
_TEST_REMEDY = (
    ". Its results would be wrong: use another device, as 'cpu', or update the driver and try it again by "
    "'sonarmap devices --test'."
)

Flavor = Literal["cpu", "gpu"]
_FLAVORS: tuple[Flavor, ...] = ("cpu", "gpu")

_OUT_OF_MEMORY = (cl.status_code.OUT_OF_RESOURCES, cl.status_code.OUT_OF_HOST_MEMORY)


class Device:
    """An in-order command queue on an OpenCL device; the queues of a process share the device's context and programs.

    Attributes:
        cl_device, context, queue: the PyOpenCL objects.
        selector: "platform:device" by number, as in `list_devices`; "" if it was not chosen from a list.
        notes: warnings for the user: which preferred devices were passed over, and why.
        flavor: the variant of its kernels: "cpu" takes one or more rows per work-item, in explicit vectors; "gpu" takes
            one voxel or column per work-item, and neighboring work-items access neighboring memory.
        allocator: allocates the memory of arrays, as `kernels.device.trace.MemoryUsage` does; None for PyOpenCL's own.
    """

    def __init__(
        self,
        device: cl.Device,
        selector: str = "",
        notes: tuple[str, ...] = (),
        flavor: Flavor | None = None,
        profiling: bool = False,
    ) -> None:
        """Open a queue on a device.

        Args:
            flavor: None: the environment variable SONARMAP_FLAVOR, else the one that suits the device. Both run on
                every device; the unsuitable one is slow and meant for tests.
            profiling: whether the queue records when each command began and ended, for `kernels.device.trace`.
        """
        self.cl_device, self.selector, self.notes = device, selector, notes
        self.flavor: Flavor = flavor or _wanted_flavor() or ("cpu" if kind(device) == "cpu" else "gpu")
        self.context, self._programs = _opened(device)
        noting = cl.command_queue_properties.PROFILING_ENABLE
        self.queue = cl.CommandQueue(self.context, properties=noting) if profiling else cl.CommandQueue(self.context)
        self.allocator: Callable[[int], cl.Buffer] | None = None

    @property
    def name(self) -> str:
        return self.cl_device.name.strip()

    @property
    def memory(self) -> int:
        return self.cl_device.global_mem_size

    @property
    def platform(self) -> str:
        """The version text of its OpenCL platform, which names the driver."""
        return self.cl_device.platform.version.strip()

    @cached_property
    def is_cpu(self) -> bool:
        """Whether kernels use their CPU flavor (explicit vectors, no barriers), and arrays lie in host memory."""
        return self.flavor == "cpu"

    def program(self, name: str, **defines: int | float) -> cl.Program:
        """The program `kernels/<name>.cl` with these macros, and GPU in the GPU flavor; built once per process."""
        options = tuple(f"-D{key}={literal(value)}" for key, value in sorted(defines.items()))
        options += () if self.is_cpu else ("-DGPU",)
        return self.build((KERNEL_FOLDER / f"{name}.cl").read_text(encoding="utf-8"), options, name)

    def build(self, source: str, options: tuple[str, ...] = (), name: str = "generated") -> cl.Program:
        """Build OpenCL C source, once per process; it may include files of kernels/: `#include "device/complex.cl"`.

        Raises:
            DeviceError: the build failed; the message contains the build log.
        """
        key = (source, options)
        if key not in self._programs:
            try:
                self._programs[key] = compile_program(self.context, source, options)
            except cl.Error as error:
                raise DeviceError(
                    f"the OpenCL program '{name}' did not build on {self.name} ({self.platform}):\n{error}"
                ) from None
        return self._programs[key]

    def empty(self, shape: tuple[int, ...], dtype: type | np.dtype = np.float32) -> cla.Array:
        """An uninitialized array on the device."""
        self.require(prod(shape) * np.dtype(dtype).itemsize)
        with self.explain_full_memory():
            return cla.empty(self.queue, shape, dtype, allocator=self.allocator)

    def to_device(self, host: np.ndarray) -> cla.Array:
        """A copy of a host array on the device, in C order."""
        self.require(host.nbytes)
        values = np.ascontiguousarray(host)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        with self.explain_full_memory():
            if self.allocator is not None and values.nbytes:
                memory = self.allocator(values.nbytes)
                cl.enqueue_copy(self.queue, memory, values)
            else:  # creating a buffer with its content does not wait for queued commands
                memory = cl.Buffer(self.context, flags, hostbuf=values) if values.nbytes else None
            return cla.Array(self.queue, values.shape, values.dtype, data=memory)

    @contextmanager
    def explain_full_memory(self) -> Generator[None]:
        """Raise a DeviceError that says what to do if the driver runs out of memory. Many drivers allocate only at the
        first launch that uses an array, and other programs use the memory too."""
        try:
            yield
        except (cl.MemoryError, cl.RuntimeError) as error:
            if not isinstance(error, cl.MemoryError) and error.code not in _OUT_OF_MEMORY:
                raise
            raise DeviceError(
                f"{self.name} has no memory or other resources left for this ({error}). "
                "Use a smaller `edge`, or close other programs; 'sonarmap doctor' says which edge fits."
            ) from None

    def require(self, largest: int, total: int = 0, hint: str = "a smaller `edge`") -> None:
        """Raise DeviceError if arrays do not fit on the device, or if this process was forked.

        Args:
            largest, total: size of the largest array, and of all arrays together [bytes].
            hint: what the message recommends to use instead.
        """
        refuse_fork()
        limit, memory = self.cl_device.max_mem_alloc_size, self.memory
        if largest > limit or total > memory:
            raise DeviceError(
                f"this needs {_size(max(total, largest))} on the device, {_size(largest)} of it in one piece; "
                f"{self.name} has {_size(memory)}, and allocates at most {_size(limit)} in one piece. Use {hint}."
            )


@cache
def _opened(device: cl.Device) -> tuple[cl.Context, dict[tuple[str, tuple[str, ...]], cl.Program]]:
    return cl.Context([device]), {}


def list_devices(test: bool = False, again: bool = True) -> list[DeviceInfo]:
    """List all OpenCL devices; each is tried with a small kernel, in a separate process per driver.

    Args:
        test: run the self-test of each working device, which takes some seconds, and remember the result.
        again: retry drivers that have timed out since the machine started; each takes a minute.

    Returns:
        The devices in the order of the drivers; `fault` says why one does not work. A driver that crashed before it
        listed a device has an entry of its own.

    Raises:
        DeviceError: there is no OpenCL driver.
    """
    return _some(try_devices(test, again))


def choose_device(selector: str | None = None) -> Device:
    """Choose the first matching device that works, GPUs before CPUs.

    A driver is loaded only after a separate process has tried it (`kernels.device.trial`). A GPU also has to pass its
    self-test, which runs before its first use with this driver and these kernels, with a line in the log. A process
    loads only one driver: later calls choose among its devices.

    Args:
        selector: "platform:device" as `list_devices` gives them, each a number or a part of a name ("0:0",
            "pocl:0"), a platform's number ("0", its first device), "cpu", "gpu", or a part of a device's or its
            platform's name or version ("3090", "pocl"). None: the environment variable PYOPENCL_CTX, in the same form,
            else any device. `kernels.device.device_info.by_preference` defines the order.

    Returns:
        The device; its `notes` say which devices were passed over, and why.

    Raises:
        InputError: the selector is not a string.
        DeviceError: no device matches, or no matching device works; the message lists the devices.
    """
    if not isinstance(selector, str | None):
        raise InputError(f"`selector` is {type(selector).__name__}; wanted a name such as 'cpu' or '0:0', or None")
    refuse_fork()
    wanted = selector or os.environ.get("PYOPENCL_CTX") or ""
    faults: list[str] = []
    for look in (known_devices, try_devices):  # remembered trials may be out of date
        infos = _some(look())
        faults = []
        for info in by_preference(_in_this_process(matching(wanted, infos))):
            if not (fault := info.fault or _test_fault(info)):
                used = f"{info.selector} {info.name}"
                notes = tuple(f"{broken}. {used} is used instead." for broken in faults)
                return Device(_loaded(info, infos), info.selector, notes)
            faults.append(f"{info.selector} {info.name} does not work: {fault}")
    raise DeviceError(
        (f"no OpenCL device that matches '{wanted}' works. " if wanted.strip() else "no OpenCL device works. ")
        + "; ".join(faults)
        + (_TEST_REMEDY if TEST_FAILED in "".join(faults) else _DRIVER_REMEDY)
    )


def _some(infos: list[DeviceInfo]) -> list[DeviceInfo]:
    if not infos:
        raise DeviceError(NO_PLATFORM)
    return infos


def _in_this_process(infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices of the driver that this process has loaded; all devices if it has loaded none."""
    driver = loaded_driver()
    usable = [info for info in infos if driver is None or info.driver_file == driver.file]
    if driver and not usable and (working := [info for info in infos if not info.fault]):
        raise DeviceError(
            f"this process has loaded the OpenCL driver {driver.file}, and a second one can crash it: use "
            f"{working[0].selector} {working[0].name} in a separate process"
        )
    return usable or infos


def _loaded(info: DeviceInfo, infos: list[DeviceInfo]) -> cl.Device:
    """PyOpenCL's device, after loading its driver; the choice is logged if another driver works too."""
    others = {each.driver_file for each in infos if not each.fault} - {info.driver_file}
    if others and loaded_driver() is None:
        LOGGER.info(f"{info.selector} {info.name} is used, by {info.driver_file}; set PYOPENCL_CTX to choose another")
    identical = [each for each in infos if (each.driver_file, each.identity) == (info.driver_file, info.identity)]
    platforms = load_devices(driver_of(info))
    devices = [device for platform in platforms for device in platform if identity(device) == info.identity]
    if len(devices) < len(identical):
        raise DeviceError(f"{info.selector} {info.name} is gone; 'sonarmap devices' lists the remaining ones")
    return devices[identical.index(info)]


def _test_fault(info: DeviceInfo) -> str:
    """Test a device other than a processor that was never tested; return why it failed, or ""."""
    if info.kind == "cpu" or info.self_test != "not tested":
        return ""
    LOGGER.info(f"testing {info.name} before it is used for the first time with this driver: this takes some seconds")
    state, reason = run_self_test(info)
    return f"{TEST_FAILED}{reason}" if state == "failed" else ""


def _wanted_flavor() -> Flavor | None:
    wanted = os.environ.get("SONARMAP_FLAVOR", "")
    if wanted and wanted not in _FLAVORS:
        raise InputError(f"the environment variable SONARMAP_FLAVOR is {wanted!r}; set it to cpu or gpu, or unset it")
    return next((flavor for flavor in _FLAVORS if flavor == wanted), None)


def _size(count: int) -> str:
    return f"{count / 2**30:.2f} GiB" if count >= 2**30 else f"{count / 2**20:.0f} MiB"
