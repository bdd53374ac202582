"""The one driver that this process has loaded. Two can end a process, as PoCLs of two versions of LLVM do."""

import os
import tempfile
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

import pyopencl as cl

from sonarmap.kernels.device.drivers import VARIABLES, Driver
from sonarmap.kernels.errors import DeviceError

_lock = Lock()
_loaded: Driver | None = None
_owner = 0  # the process that loaded it


def loaded_driver() -> Driver | None:
    """The driver of this process, once it has one."""
    return _loaded


def refuse_fork() -> None:
    """Refuse a process that was forked from one that had loaded a driver: the driver's threads are not in it, and what
    waits for them waits for ever.

    Raises:
        DeviceError: saying how to start it instead.
    """
    if _loaded is not None and os.getpid() != _owner:
        raise DeviceError(
            "this process was forked from one that had used an OpenCL device, which cannot work here; start it anew, "
            "as by multiprocessing.get_context('spawn')"
        )


def load_devices(driver: Driver, folder: str | None = None) -> list[list[cl.Device]]:
    """Load a driver, if it is not loaded yet, and nothing else: the devices of each of its platforms.

    Where other code has asked for OpenCL's platforms before, all drivers are loaded already, and give their devices.

    Args:
        folder: for a temporary file, which stays where the driver ends the process; None: the system's.

    Raises:
        DeviceError: this process has another one.
    """
    global _loaded, _owner
    refuse_fork()
    with _lock:
        if _loaded is not None and _loaded != driver:
            raise DeviceError(f"this process has loaded the OpenCL driver {_loaded.file}, not {driver.file}")
        # of PyOpenCL's own programs
        warnings.filterwarnings("ignore", category=cl.CompilerWarning, module="pyopencl")
        with _alone(driver, folder):
            try:
                platforms = cl.get_platforms()
            except cl.Error:  # there is none
                platforms = []
            _loaded, _owner = driver, os.getpid()
            return [_devices(platform) for platform in platforms]


@contextmanager
def temporary_folder(within: str | None = None) -> Generator[str]:
    """A folder for as long as the block lasts."""
    try:
        made = tempfile.TemporaryDirectory(prefix="sonarmap-driver-", dir=within)
    except OSError as error:
        raise DeviceError(
            f"to load an OpenCL driver takes a temporary file, which cannot be written ({error}); set TMPDIR to a "
            "folder that can"
        ) from error
    with made as folder:
        yield folder


def _devices(platform: cl.Platform) -> list[cl.Device]:
    try:
        return platform.get_devices()
    except cl.Error:  # a platform without devices is not an error of ours
        return []


@contextmanager
def _alone(driver: Driver, within: str | None) -> Generator[None]:
    """Have the loader, which looks around once in a process, see one driver.

    PyOpenCL's own loader also takes what lies beside it, wherever the variables point.
    """
    if not driver.library:
        yield
        return
    names = (*VARIABLES, "PYOPENCL_HOME")
    before = {name: os.environ[name] for name in names if name in os.environ}
    with temporary_folder(within) as folder:
        Path(folder, "driver.icd").write_text(f"{driver.library}\n", encoding="utf-8")
        os.environ.update(dict.fromkeys(names, folder))
        try:
            yield
        finally:
            for name in names:
                del os.environ[name]
            os.environ.update(before)
