"""Records about this machine's devices in the user's cache folder, such as test results. They only save time: if the
folder cannot be written, a warning is logged once, and every run repeats the work."""

import atexit
import json
import os
import shutil
import tempfile
from contextlib import suppress
from hashlib import sha256
from logging import getLogger
from pathlib import Path
from typing import Any

import platformdirs

LOGGER = getLogger("sonarmap")
_REMEDY = (
    "compiled kernels and test results of a device are not kept, and the next run repeats the work, which takes "
    "some seconds. Set {} to a writable folder."
)
_ROOM = 1 << 20  # bytes that a compiled program needs
_warned: set[Path] = set()
_unwritten: dict[Path, dict[str, Any]] = {}  # records that only this process has


def cache_folder() -> Path:
    """The folder of the records; XDG_CACHE_HOME moves it on Linux."""
    return platformdirs.user_cache_path("sonarmap", appauthor=False)


def kernel_cache() -> Path:
    """The folder in which PoCL keeps compiled kernels."""
    if folder := os.environ.get("POCL_CACHE_DIR"):
        return Path(folder)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "pocl", "kcache")


def require_caches() -> None:
    """Redirect the caches of OpenCL libraries to a temporary folder if theirs cannot be written: PoCL would show no
    devices, and PyOpenCL would build no kernels. Call it before a driver is loaded."""
    if os.name != "posix":
        return
    pocl = kernel_cache()
    named = "POCL_CACHE_DIR" in os.environ
    if named and (fault := _fault(pocl)):
        _replace("POCL_CACHE_DIR", pocl, fault)
    pyopencl = platformdirs.user_cache_path("pytools", "pytools")
    for folder in (cache_folder(), pyopencl, *(() if named else (pocl,))):
        if fault := _fault(folder):
            _replace("XDG_CACHE_HOME", folder, fault)
            return


def recall(name: str) -> dict[str, Any]:
    """The record that `remember` wrote under this name; empty if the file is missing or damaged."""
    path = cache_folder() / f"{name}.json"
    if path in _unwritten:
        return _unwritten[path]
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def remember(name: str, content: dict[str, Any]) -> None:
    """Write a record atomically; if the folder cannot be written, warn once and keep the record in this process."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=folder, prefix=name)
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                json.dump(content, file, indent=1)
            Path(temporary).replace(folder / f"{name}.json")
        except BaseException:
            with suppress(OSError):
                Path(temporary).unlink()
            raise
    except OSError as error:
        _unwritten[folder / f"{name}.json"] = content
        _warn("XDG_CACHE_HOME", folder, _reason(error))


def digest(*parts: str) -> str:
    """A hash of these texts, 16 hexadecimal digits."""
    return sha256("\0".join(parts).encode()).hexdigest()[:16]


def _fault(folder: Path) -> str:
    """Why a folder cannot be written, or ""; missing folders are not created."""
    try:
        existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
        with tempfile.TemporaryFile(dir=existing) as file:
            file.write(bytes(_ROOM))  # without this room the compiler would end the process
    except OSError as error:
        return _reason(error)
    return ""


def _replace(variable: str, folder: Path, reason: str) -> None:
    instead = tempfile.mkdtemp(prefix="sonarmap-cache-")
    atexit.register(shutil.rmtree, instead, ignore_errors=True)
    os.environ[variable] = instead
    _warn(variable, folder, reason)


def _warn(variable: str, folder: Path, reason: str) -> None:
    if folder not in _warned:
        _warned.add(folder)
        LOGGER.warning(f"the cache folder {folder} cannot be written ({reason}): {_REMEDY.format(variable)}")


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
