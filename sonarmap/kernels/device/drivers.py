"""The OpenCL drivers of this machine, by the .icd files that name them, and the one that this process has loaded.

Two drivers can end a process, as PoCLs of two versions of LLVM do.
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

# Of the loader; the first is ocl-icd's, the second Khronos'.
VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH")
_ENTRY = "clGetExtensionFunctionAddress"  # which a loader asks every driver for (cl_khr_icd)
SYSTEM_FOLDER = Path("/etc/OpenCL/vendors")


@dataclass(frozen=True, slots=True)
class Driver:
    """A driver that a process can load: the file .icd that names it, or the library itself, and the library's path or
    name; both "" for whatever the system's loader finds by itself."""

    file: str = ""
    library: str = ""


def vendor_folder(environment: Mapping[str, str] = os.environ) -> tuple[Path, str]:
    """Where drivers are looked for, and which variable says so, if any does."""
    for variable in VARIABLES:
        if place := environment.get(variable):
            named = SYSTEM_FOLDER / place
            return (named if place.endswith(".icd") and named.is_file() else Path(place)), variable
    return SYSTEM_FOLDER, ""


def installed_drivers(environment: Mapping[str, str] = os.environ) -> list[Driver]:
    """All drivers, each once, in the order of their files: those where a variable points, else the system's, pip's and
    conda's; without any the one that the system's loader may find by itself."""
    place, variable = vendor_folder(environment)
    if place.is_file() and place.suffix != ".icd":
        return [Driver(str(place), str(place))]
    files = [place] if place.is_file() else sorted(place.glob("*.icd"))
    drivers = [Driver(str(file), _library(file)) for file in files]
    if not variable:
        own = sorted(Path(sys.prefix, "etc", "OpenCL", "vendors").glob("*.icd"))
        own += sorted(Path(sysconfig.get_path("platlib"), "pyopencl", ".libs").glob("*.icd"))
        drivers += [Driver(str(file), library) for file in own if Path(library := _library(file)).is_file()]
    found = {os.path.realpath(driver.library): driver for driver in reversed(drivers)}
    return [*reversed(found.values())] or [Driver()]


def driver_fault(driver: Driver) -> str:
    """Why a driver gives no device, if its file or library says so; loading may end the process."""
    if not driver.library:
        return f"{driver.file} names no library" if driver.file else ""
    try:
        library = ctypes.CDLL(driver.library)
    except OSError as error:
        return str(error)
    return "" if hasattr(library, _ENTRY) else f"{driver.library} is no OpenCL driver"


def _library(file: Path) -> str:
    """What a .icd file names: its absolute path beside the file, or in the environment where pip put it."""
    try:
        library = file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
    if "\0" in library:  # no path has one
        return ""
    near = (file.parent / library, Path(sys.prefix, "lib", Path(library).name))
    return next((str(path) for path in near if library and path.is_file()), library)


_lock = Lock()
_loaded: Driver | None = None
_owner = 0  # the process that loaded it


def loaded_driver() -> Driver | None:
    """The driver of this process, once it has one."""
    return _loaded


def refuse_fork() -> None:
    """Refuse a process that was forked from one that had loaded a driver: it would wait for the driver's threads for
    ever."""
    if _loaded is not None and os.getpid() != _owner:
        raise DeviceError(
            "this process was forked from one that had used an OpenCL device, which cannot work here; start it anew, "
            "as by multiprocessing.get_context('spawn')"
        )


def load_devices(driver: Driver, folder: str | None = None) -> list[list[cl.Device]]:
    """Load a driver, if it is not loaded yet, and nothing else: the devices of each of its platforms.

    Where other code has asked for OpenCL's platforms before, all drivers are loaded already, and give their devices.
    The folder is for a temporary file, which stays where the driver ends the process; None: the system's.
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
    """Have the loader see one driver. PyOpenCL's own also takes what lies beside it, wherever the variables point."""
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
