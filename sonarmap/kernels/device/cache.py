"""What is remembered of this machine's devices between runs, in the user's cache folder. Nothing depends on it: where a
folder cannot be written, that is said once, and the work is done again."""

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
    "what is compiled and tested for a device is forgotten after this run, and done again in the next, which takes "
    "some seconds. Set {} to a folder that can be written."
)
_ROOM = 1 << 20  # bytes, of a compiled program
_warned: set[Path] = set()
_unwritten: dict[Path, dict[str, Any]] = {}  # what this process alone remembers


def cache_folder() -> Path:
    """Where sonarmap remembers; XDG_CACHE_HOME moves it on Linux."""
    return platformdirs.user_cache_path("sonarmap", appauthor=False)


def kernel_cache() -> Path:
    """Where PoCL keeps compiled kernels."""
    if folder := os.environ.get("POCL_CACHE_DIR"):
        return Path(folder)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "pocl", "kcache")


def require_caches() -> None:
    """Have the OpenCL libraries write to a temporary folder where they could not write to theirs: PoCL would have no
    devices, and PyOpenCL no kernels. It has to be called before a driver is loaded."""
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
    """What `remember` wrote under this name; nothing where there is no such file, or a damaged one."""
    path = cache_folder() / f"{name}.json"
    if path in _unwritten:
        return _unwritten[path]
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def remember(name: str, content: dict[str, Any]) -> None:
    """Write a whole file or none; where the folder cannot be written, say so once and keep it for this process."""
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
    """16 letters that stand for these texts."""
    return sha256("\0".join(parts).encode()).hexdigest()[:16]


def _fault(folder: Path) -> str:
    """Why nothing can be written there, or ""; folders that are not there yet are not made."""
    try:
        there = next(parent for parent in (folder, *folder.parents) if parent.exists())
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(bytes(_ROOM))  # where it runs out, the compiler ends the whole process
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
