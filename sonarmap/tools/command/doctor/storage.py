"""Disks: where results, temporary files and caches go, whether they can be written, and how much room is left."""

import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sonarmap.tools.command.doctor.finding import Finding, Remedy, Verdict, size, worst

_PLENTY, _LEAST = 1 << 30, 32 << 20  # bytes free: of a survey of thousands of scans, and of a small one
_TRIAL = 64 << 10  # bytes that are written to see whether a file can grow


@dataclass(frozen=True, slots=True)
class Place:
    """A folder that something is written to."""

    path: Path  # the folder, which need not be there yet
    free: int  # room for who runs this [bytes]
    fault: str  # why nothing can be written there, or ""

    @property
    def verdict(self) -> Verdict:
        """Whether results can be written there."""
        if self.fault or self.free < _LEAST:
            return "wrong"
        return "ok" if self.free >= _PLENTY else "warning"

    def words(self) -> str:
        """What there is to say of it."""
        return f"{self.path}: {self.fault}" if self.fault else f"{self.path}: {size(self.free)} free"

    def details(self) -> dict[str, Any]:
        """The same for programs."""
        return {"folder": str(self.path), "free": self.free, "fault": self.fault}


def results(folder: Path) -> Finding:
    """The folder that results go to."""
    place, limit = look_at(folder), _file_limit()
    verdict, seen, details = place.verdict, place.words(), place.details() | {"file limit": limit}
    remedies = () if verdict == "ok" else (Remedy("make room there, or choose another folder with -o OUT"),)
    if limit is not None and limit < _PLENTY:
        verdict = worst([verdict, "wrong" if limit < _LEAST else "warning"])
        seen += f"; files can grow to {size(limit)} only (ulimit -f)"
        remedies += (Remedy("let files grow:", "ulimit -f unlimited"),)
    return Finding(verdict, seen, remedies, details)


def temporary_folder() -> Finding:
    """Where scans that do not fit in memory and unpacked recordings go."""
    try:
        place = look_at(Path(tempfile.gettempdir()))
    except OSError as error:  # none of those that Python tries
        place = Place(Path(os.environ.get("TMPDIR", "/tmp")), 0, _reason(error))
    if place.verdict == "ok":
        return Finding("ok", place.words(), details=place.details())
    elsewhere = Remedy("name a folder with room for temporary files:", "export TMPDIR=/var/tmp")
    return Finding("wrong" if place.fault else "warning", place.words(), (elsewhere,), place.details())


def caches() -> Finding:
    """Where compiled kernels and self-tests are remembered. Without them all is compiled again in each run."""
    from sonarmap.kernels.device.cache import cache_folders

    places = {name: look_at(folder) for name, folder in {**cache_folders(), "matplotlib": _matplotlib()}.items()}
    bad = {name: place for name, place in places.items() if place.fault or place.free < _TRIAL}
    sizes = {name: _size_of(place.path) for name, place in places.items()}
    details = {
        name: {"folder": "", "exists": place.path.is_dir(), "size": sizes[name]} | place.details()
        for name, place in places.items()
    }
    if not bad:
        folders = {str(place.path.parent) for place in places.values()}
        common = Path(os.path.commonpath(folders)) if len(folders) > 1 else Path(*folders)
        parts = ", ".join(f"{name} {size(sizes[name])}" for name in places)
        return Finding("ok", f"{common}: {parts}", details=details)
    faults: dict[str, list[str]] = {}
    for name, place in bad.items():
        faults.setdefault(place.fault or "the disk is full", []).append(f"{name} {place.path}")
    seen = [f"{fault}: {', '.join(names)}" for fault, names in faults.items()]
    seen.append("kernels are compiled again in each run, which takes some seconds")
    spare = _spare_folder()
    variables = [f"XDG_CACHE_HOME={spare}"] if set(bad) - {"matplotlib"} else []
    variables += [f"POCL_CACHE_DIR={spare}/pocl"] if "PoCL" in bad and "POCL_CACHE_DIR" in os.environ else []
    variables += [f"MPLCONFIGDIR={spare}/matplotlib"] if "matplotlib" in bad else []
    elsewhere = Remedy("have them in a folder that can be written:", f"export {' '.join(variables)}")
    return Finding("warning", "\n".join(seen), (elsewhere,), details)


def look_at(folder: Path) -> Place:
    """Whether a folder, or the parent that it would be made in, can be written, and how much room there is."""
    folder = folder.absolute()
    try:
        there = next((parent for parent in (folder, *folder.parents) if parent.exists()), folder)
        free = shutil.disk_usage(there).free
    except OSError as error:  # a parent is of another user
        return Place(folder, 0, _reason(error))
    if not there.is_dir():
        return Place(folder, free, f"{there} is a file, not a folder")
    try:
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(bytes(_TRIAL))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        return Place(folder, free, _reason(error))
    return Place(folder, free, "")


def _matplotlib() -> Path:
    if folder := os.environ.get("MPLCONFIGDIR"):
        return Path(folder)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "matplotlib")


def _spare_folder() -> Path:
    """A folder for the caches, where there is room."""
    try:
        return Path(tempfile.gettempdir(), "sonarmap-cache")
    except OSError:
        return Path("/var/tmp/sonarmap-cache")


def _size_of(folder: Path) -> int:
    """Of all files in it [bytes]."""
    total = 0
    for inside, _, names in os.walk(folder):
        for name in names:
            try:
                total += Path(inside, name).lstat().st_size
            except OSError:  # another process tidies up
                continue
    return total


def _file_limit() -> int | None:
    """How large a file may grow [bytes]; None where nothing limits it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return None if limit == resource.RLIM_INFINITY else limit


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
