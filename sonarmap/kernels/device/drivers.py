"""The OpenCL drivers of this machine, by the .icd files that name them. Only the standard library is imported here."""

import ctypes
import os
import sys
import sysconfig
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

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
    """What a .icd file names: its absolute path where it lies beside the file, or in the environment that has it.

    Files that pip installs may name the folder that their maker had.
    """
    try:
        library = file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
    if "\0" in library:  # no path has one
        return ""
    near = (file.parent / library, Path(sys.prefix, "lib", Path(library).name))
    return next((str(path) for path in near if library and path.is_file()), library)
