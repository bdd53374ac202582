"""The OpenCL drivers that the loader is told of: which files name them, and whether they can be loaded."""

import ctypes
import os
import sysconfig
from collections.abc import Mapping
from pathlib import Path

# Of the loader; the first is ocl-icd's, the second Khronos'.
VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH")
SYSTEM_FOLDER = Path("/etc/OpenCL/vendors")


def vendor_folder(environment: Mapping[str, str] = os.environ) -> tuple[Path, str]:
    """Where the loader looks for the files of drivers, and which variable says so, if any does."""
    for variable in VARIABLES:
        if place := environment.get(variable):
            return Path(place), variable
    return SYSTEM_FOLDER, ""


def driver_files(environment: Mapping[str, str] = os.environ) -> list[Path]:
    """The .icd files: of the system, or where a variable says, and the one that pip's PoCL brings."""
    place, _ = vendor_folder(environment)
    files = [place] if place.suffix == ".icd" else sorted(place.glob("*.icd"))
    beside = Path(sysconfig.get_path("platlib"), "pyopencl", ".libs")
    return [*files, *sorted(beside.glob("*.icd"))]


def driver_fault(file: Path) -> str:
    """Why the library that a .icd file names cannot be loaded, or ""; loading may end the process."""
    try:
        library = file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError as error:
        return str(error.strerror or error)
    if not library:
        return "the file is empty"
    beside = file.parent / library
    try:
        ctypes.CDLL(str(beside) if beside.is_file() else library)
    except OSError as error:
        return str(error)
    return ""
