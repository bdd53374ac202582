"""Reading whole files that a user names, JSON among them, with errors that say what to do."""

import hashlib
import json
import math
import os
import platform
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory

# Pipes and devices that may be read; a shell passes `<(...)` as /dev/fd/N or /proc/self/fd/N.
_GIVEN = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/", os.devnull)
_LARGEST_PIPE = 1 << 28  # bytes
_HEAD = 4096  # bytes by which a file format is recognized
_LARGEST = 1e30  # largest number in a JSON file: `LARGEST_INFORMATION` of `readers.instruments`
_LARGEST_INTEGER = 2**63 - 1
PACKAGES = ("sonarmap", "numpy", "scipy", "pyopencl", "gtsam", "open3d")


@dataclass(frozen=True, slots=True)
class Kind:
    """A file format."""

    kind: str  # its name in messages, as "a PLY file"
    start: bytes  # a regular expression for the first bytes of its files


def require_kind(path: Path, kinds: Mapping[str, Kind]) -> None:
    """Raise InputError if the content of a file does not match its suffix. `kinds`: {suffix: format}, with formats last
    whose pattern matches others too. The caller adds the file's name to the message."""
    if path.exists() and not path.is_file():
        raise InputError("it is not a regular file; give a file, a folder or a pattern")
    with unreadable(), path.open("rb") as file:
        head = file.read(_HEAD)
    if not head:
        raise InputError("the file is empty (0 bytes); write or copy it again")
    expected = kinds[path.suffix.lower()].kind
    kind = next((each.kind for each in kinds.values() if re.match(each.start, head)), "binary content of no known kind")
    if kind != expected:
        suffixes = [suffix for suffix, each in kinds.items() if each.kind == kind]
        hint = f"rename it to {' or '.join(suffixes)} if that is what it is" if suffixes else "write or copy it again"
        raise InputError(f"it is called {path.suffix} but holds {kind}; wanted {expected}: {hint}")


@contextmanager
def naming(place: object, remedy: str = "") -> Iterator[None]:
    """Prefix the message of an InputError in the block with a file, or a line of it, and append a remedy."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}{remedy}") from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn an OSError in the block into an InputError that says that the file cannot be read."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; check its name and permissions") from error


@contextmanager
def unreadable() -> Iterator[None]:
    """Like `reading`, for callers that add the file's name to the message themselves."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error}); check its permissions") from error


def read_content(path: Path, pipe: bool = False) -> bytes:
    """The bytes of a file. `pipe`: whether a pipe is accepted, which can be read only once: /dev/stdin or a shell's
    <(...)."""
    require_file(path, pipe)
    most = None if path.is_file() else _LARGEST_PIPE
    with reading(path), path.open("rb") as file:
        if most is None:
            require_memory(str(path), path.stat().st_size, "give a smaller file")
        content = file.read() if most is None else file.read(most + 1)
    if most is not None and len(content) > most:
        raise InputError(f"{path} gives more than {most >> 20} MiB; write it to a file, and give that")
    return content


def require_file(path: Path, pipe: bool = False) -> None:
    """Raise InputError for a device or a pipe, which may block or never end, before it is opened. With `pipe` those
    that a shell passes to a command are accepted. Folders and missing files are left to the code that opens them."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return
    except ValueError as error:
        raise InputError(f"cannot read {path}: {error}; check its name") from error
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode) or (pipe and str(path).startswith(_GIVEN))):
        raise InputError(f"cannot read {path}: it is a pipe or a device; wanted a file: write it to one, and give that")


def read_json(path: Path, expected: str) -> Any:
    """The content of a JSON file. `expected` says in errors what the file should be."""
    try:
        text = read_content(Path(path), pipe=True).decode("utf-8")
        return json.loads(text, parse_float=_number, parse_int=_integer, parse_constant=_no_number)
    except InputError as error:
        raise InputError(f"{error}; expected {expected}") from error
    except ValueError as error:
        reason = str(error)
    except RecursionError:
        reason = "it is nested too deeply"
    raise InputError(f"cannot read {path}: {reason}; expected {expected}")


def _number(text: str) -> float:
    number = float(text)
    return number if math.fabs(number) <= _LARGEST else _no_number(text)


def _integer(text: str) -> int:
    return int(text) if len(text) <= 20 and abs(int(text)) <= _LARGEST_INTEGER else _no_number(text)


def _no_number(text: str) -> Any:
    raise ValueError(f"it holds the number {text[:40]}, which is too large or not finite")


def input_rows(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Name, size [bytes] and SHA-256 of files and of the files in folders; size and SHA-256 are None for unreadable
    files. Names are relative to the common parent folder, so that they reveal nothing of the machine. Takes about a
    second per gigabyte."""
    files = [file.resolve() for path in paths for file in _files_of(path)]
    shared = os.path.commonpath([file.parent for file in files]) if files else ""
    return [{"name": file.relative_to(shared).as_posix(), **_content_of(file)} for file in dict.fromkeys(files)]


def _content_of(file: Path) -> dict[str, Any]:
    try:
        return {"bytes": file.stat().st_size, "sha256": sha256_of(file)}
    except (OSError, InputError):
        return {"bytes": None, "sha256": None}


def sha256_of(path: Path) -> str:
    require_file(path)
    with reading(path), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _files_of(path: Path) -> list[Path]:
    """The file itself, or all files in a folder: some recordings are folders."""
    return sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]


def package_versions(*also: str) -> dict[str, str | None]:
    """Versions of Python, of the packages that affect results, and of `also`; None for one that is not installed."""
    versions: dict[str, str | None] = {"python": platform.python_version(), "system": platform.platform()}
    for package in (*PACKAGES, *also):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    return versions
