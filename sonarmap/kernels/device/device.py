"""Choose and list OpenCL devices, build programs once, check memory before it is taken.

An OpenCL context must never be inherited by a forked process: spawn workers, and let each make its own `Device`.
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

_FULL = (cl.status_code.OUT_OF_RESOURCES, cl.status_code.OUT_OF_HOST_MEMORY)


class Device:
    """An in-order queue on one device. All of a process share one context, with the programs built for it.

    Attributes:
        cl_device, context, queue: PyOpenCL's.
        selector: "platform:device" by number, as `list_devices` gives it; "" where it was not chosen from a list.
        notes: sentences that a user should read: which preferred devices were passed over, and why.
        flavor: how its kernels are written: "cpu", a row or a few per work-item in explicit vectors, or "gpu", a voxel
            or a column per work-item, neighbors beside each other in memory.
        allocator: what gives arrays their memory; None: PyOpenCL. `kernels.device.trace.MemoryUsage` counts by it.
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
            flavor: None: what the environment variable SONARMAP_FLAVOR says, else as suits the device. Either runs on
                every device; the other one is slow, and for tests.
            profiling: whether the queue notes when each command began and ended, for `kernels.device.trace`.
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
        """Whether kernels are written in their CPU flavor (explicit vectors, no barriers), and memory is the host's."""
        return self.flavor == "cpu"

    def program(self, name: str, **defines: int | float) -> cl.Program:
        """The program of `kernels/<name>.cl`, built once per process and set of macros; GPU is one in the GPU
        flavor."""
        options = tuple(f"-D{key}={literal(value)}" for key, value in sorted(defines.items()))
        options += () if self.is_cpu else ("-DGPU",)
        return self.build((KERNEL_FOLDER / f"{name}.cl").read_text(encoding="utf-8"), options, name)

    def build(self, source: str, options: tuple[str, ...] = (), name: str = "generated") -> cl.Program:
        """Build OpenCL C source, once per process; it can include files of kernels/, as `#include "device/complex.cl"`.

        Raises:
            DeviceError: it does not build; the build log is in the message.
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
            else:  # a buffer born with its content does not wait for what the queue does
                memory = cl.Buffer(self.context, flags, hostbuf=values) if values.nbytes else None
            return cla.Array(self.queue, values.shape, values.dtype, data=memory)

    @contextmanager
    def explain_full_memory(self) -> Generator[None]:
        """Raise a DeviceError that says what to do where the driver has no memory left. Many drivers take it at the
        first launch that needs it, and other programs use it too."""
        try:
            yield
        except (cl.MemoryError, cl.RuntimeError) as error:
            if not isinstance(error, cl.MemoryError) and error.code not in _FULL:
                raise
            raise DeviceError(
                f"{self.name} has no memory or other resources left for this ({error}). "
                "Use a smaller `edge`, or end other programs; 'sonarmap doctor' says which fits."
            ) from None

    def require(self, largest: int, total: int = 0, hint: str = "a smaller `edge`") -> None:
        """Refuse work that the device cannot hold, or that a forked process asks for.

        Args:
            largest, total: size of the largest single array, and of all together [bytes].
            hint: what the message says to use instead.
        """
        refuse_fork()
        limit, memory = self.cl_device.max_mem_alloc_size, self.memory
        if largest > limit or total > memory:
            raise DeviceError(
                f"this needs {_size(max(total, largest))} on the device, {_size(largest)} of it in one piece; "
                f"{self.name} has {_size(memory)}, and gives at most {_size(limit)} in one piece. Use {hint}."
            )


@cache
def _opened(device: cl.Device) -> tuple[cl.Context, dict[tuple[str, tuple[str, ...]], cl.Program]]:
    return cl.Context([device]), {}


def list_devices(test: bool = False, again: bool = True) -> list[DeviceInfo]:
    """Every OpenCL device, each tried with a small kernel, in processes of their own.

    Args:
        test: run the self-test of each that works, which takes some seconds, and remember what came out.
        again: try drivers once more that did not answer since the machine started, each of which takes a minute.

    Returns:
        In the order of the drivers; a device that does not work says why in its `fault`, and so does a driver that
        ended the process before it had one.

    Raises:
        DeviceError: there is no OpenCL driver.
    """
    return _some(try_devices(test, again))


def device_names() -> list[tuple[str, str]]:
    """The selector and the name of every OpenCL device, as last tried."""
    return [(info.selector, info.name) for info in _some(known_devices())]


def choose_device(selector: str | None = None) -> Device:
    """The first device in order of preference that matches and works: GPUs come before CPUs.

    A driver is loaded only after it was tried in a process of its own (`kernels.device.trial`), and a GPU is believed
    only after its self-test, which is run before its first use with this driver and these kernels; that it runs is
    logged. A process loads one driver: the first choice decides for all that follow.

    Args:
        selector: "platform:device" as `list_devices` gives them, each a number or a part of a name ("0:0",
            "pocl:0"), a platform's number ("0", its first device), "cpu", "gpu", or a part of a device's or its
            platform's name or version ("3090", "pocl"). None: what the environment variable PYOPENCL_CTX says in
            the same form, else any. `kernels.device.device_info.by_preference` has the order.

    Returns:
        The device; its `notes` say which ones were passed over, and why.

    Raises:
        InputError: the selector is no text.
        DeviceError: nothing matches, or nothing that matches works; the message lists what is there.
    """
    if not isinstance(selector, str | None):
        raise InputError(f"`selector` is {type(selector).__name__}; wanted a name such as 'cpu' or '0:0', or None")
    refuse_fork()
    wanted = selector or os.environ.get("PYOPENCL_CTX") or ""
    faults: list[str] = []
    for look in (known_devices, try_devices):  # what is remembered may be out of date
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
    """Those of the driver that this process has loaded, if it has one."""
    driver = loaded_driver()
    own = [info for info in infos if driver is None or info.driver_file == driver.file]
    if driver and not own and (working := [info for info in infos if not info.fault]):
        raise DeviceError(
            f"this process has loaded the OpenCL driver {driver.file}, and two in one process can end it: use "
            f"{working[0].selector} {working[0].name} in a process of its own"
        )
    return own or infos


def _loaded(info: DeviceInfo, infos: list[DeviceInfo]) -> cl.Device:
    """PyOpenCL's device, of a driver that is loaded now; which one is logged where there is a choice."""
    others = {each.driver_file for each in infos if not each.fault} - {info.driver_file}
    if others and loaded_driver() is None:
        LOGGER.info(f"{info.selector} {info.name} is used, by {info.driver_file}; PYOPENCL_CTX chooses another")
    alike = [each for each in infos if (each.driver_file, each.identity) == (info.driver_file, info.identity)]
    platforms = load_devices(driver_of(info))
    devices = [device for platform in platforms for device in platform if identity(device) == info.identity]
    if len(devices) < len(alike):
        raise DeviceError(f"{info.selector} {info.name} is not there any more; 'sonarmap devices' shows what is")
    return devices[alike.index(info)]


def _test_fault(info: DeviceInfo) -> str:
    """What the self-test says against a device; what is no processor is tested before it is believed."""
    if info.kind == "cpu" or info.self_test != "not tested":
        return ""
    LOGGER.info(f"testing {info.name} before it is used for the first time with this driver: this takes some seconds")
    state, reason = run_self_test(info)
    return f"{TEST_FAILED}{reason}" if state == "failed" else ""


def _wanted_flavor() -> Flavor | None:
    wanted = os.environ.get("SONARMAP_FLAVOR", "")
    if wanted and wanted not in _FLAVORS:
        raise InputError(f"the environment's SONARMAP_FLAVOR is {wanted!r}; wanted cpu, gpu, or nothing")
    return next((flavor for flavor in _FLAVORS if flavor == wanted), None)


def _size(count: int) -> str:
    return f"{count / 2**30:.2f} GiB" if count >= 2**30 else f"{count / 2**20:.0f} MiB"
