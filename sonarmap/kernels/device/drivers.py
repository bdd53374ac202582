"""The OpenCL drivers of this machine, named by .icd files, and the driver that this process has loaded.

Two drivers in one process can crash it, for example two PoCLs with different versions of LLVM.
"""

import ctypes
import os
import sys
import sysconfig
import tempfile
import warnings
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import pyopencl as cl

from sonarmap.kernels.errors import DeviceError

# Environment variables of the loaders ocl-icd and Khronos.
VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH")
_ENTRY = "clGetExtensionFunctionAddress"  # function that loaders look up in every driver (cl_khr_icd)
SYSTEM_FOLDER = Path("/etc/OpenCL/vendors")


@dataclass(frozen=True, slots=True)
class Driver:
    """An OpenCL driver: its .icd file, or the library itself, and the library's path or name; both are "" for the
    drivers that the system's loader finds by itself."""

    file: str = ""
    library: str = ""


def vendor_folder(environment: Mapping[str, str] = os.environ) -> tuple[Path, str]:
    """The folder or file that names drivers, and the variable that sets it, or ""."""
    for variable in VARIABLES:
        if place := environment.get(variable):
            named = SYSTEM_FOLDER / place
            return (named if place.endswith(".icd") and named.is_file() else Path(place)), variable
    return SYSTEM_FOLDER, ""


def installed_drivers(environment: Mapping[str, str] = os.environ) -> list[Driver]:
    """All drivers, without duplicates, in the order of their files: those that a variable points to, else the system's,
    pip's and conda's. If there are none, `Driver()`: what the system's loader may find by itself."""
    place, variable = vendor_folder(environment)
    if place.is_file() and place.suffix != ".icd":
        return [Driver(str(place), str(place))]
    files = [place] if place.is_file() else sorted(place.glob("*.icd"))
    drivers = [Driver(str(file), _library(file)) for file in files]
    if not variable:
        files = sorted(Path(sys.prefix, "etc", "OpenCL", "vendors").glob("*.icd"))
        files += sorted(Path(sysconfig.get_path("platlib"), "pyopencl", ".libs").glob("*.icd"))
        drivers += [Driver(str(file), library) for file in files if Path(library := _library(file)).is_file()]
    by_library = {os.path.realpath(driver.library): driver for driver in reversed(drivers)}
    return [*reversed(by_library.values())] or [Driver()]


def driver_fault(driver: Driver) -> str:
    """Why a driver cannot be loaded, or "" if there is no obvious reason. Loading it may crash the process."""
    if not driver.library:
        return f"{driver.file} names no library" if driver.file else ""
    try:
        library = ctypes.CDLL(driver.library)
    except OSError as error:
        return str(error)
    return "" if hasattr(library, _ENTRY) else f"{driver.library} is no OpenCL driver"


def _library(file: Path) -> str:
    """The library that a .icd file names, as a path if it lies beside the file or in Python's environment."""
    try:
        library = file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
    if "\0" in library:  # not valid in a path
        return ""
    near = (file.parent / library, Path(sys.prefix, "lib", Path(library).name))
    return next((str(path) for path in near if library and path.is_file()), library)


_lock = Lock()
_loaded: Driver | None = None
_owner = 0  # id of the process that loaded it


def loaded_driver() -> Driver | None:
    """The driver that this process has loaded, or None."""
    return _loaded


def refuse_fork() -> None:
    """Raise DeviceError if this process was forked after a driver was loaded: it would wait forever for its threads."""
    if _loaded is not None and os.getpid() != _owner:
        raise DeviceError(
            "this process was forked from one that had used an OpenCL device, and cannot use it; start a new process "
            "instead, as with multiprocessing.get_context('spawn')"
        )


def load_devices(driver: Driver, folder: str | None = None) -> list[list[cl.Device]]:
    """Load this driver alone, unless it is loaded already, and return the devices of each of its platforms.

    If other code has listed OpenCL's platforms before, all drivers are loaded, and all their devices are returned. A
    temporary file is written to `folder` (None: the system's), and stays there if the driver crashes the process.
    """
    global _loaded, _owner
    refuse_fork()
    with _lock:
        if _loaded is not None and _loaded != driver:
            raise DeviceError(f"this process has loaded the OpenCL driver {_loaded.file}, not {driver.file}")
        # warnings about PyOpenCL's own programs
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
    """A folder that exists while the block runs."""
    try:
        made = tempfile.TemporaryDirectory(prefix="sonarmap-driver-", dir=within)
    except OSError as error:
        raise DeviceError(
            f"loading an OpenCL driver needs a temporary file, which cannot be written ({error}); set TMPDIR to a "
            "writable folder"
        ) from error
    with made as folder:
        yield folder


def _devices(platform: cl.Platform) -> list[cl.Device]:
    try:
        return platform.get_devices()
    except cl.Error:  # the platform has no devices
        return []


@contextmanager
def _alone(driver: Driver, within: str | None) -> Generator[None]:
    """Show the loader only this driver. PyOpenCL's own loader also searches its own folder, PYOPENCL_HOME."""
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
