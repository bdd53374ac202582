"""What a result was made from: name, size and SHA-256 of its files, and the versions of the packages."""

import hashlib
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import require_file

PACKAGES = ("sonarmap", "numpy", "scipy", "pyopencl", "gtsam", "open3d")


def input_rows(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Name, bytes and SHA-256 of files, and of what is in folders; both null of a file that cannot be read. Names start
    at the folder that all of them share, so that they say nothing of the machine. Files are read in pieces, a second
    for each gigabyte or so."""
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
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}. Check the path and permissions") from error


def _files_of(path: Path) -> list[Path]:
    """The file itself, or all files in the folder: some recordings are folders."""
    return sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]


def package_versions(*also: str) -> dict[str, str | None]:
    """The versions of Python and of what the numbers depend on; None for a package that is not installed."""
    versions: dict[str, str | None] = {"python": platform.python_version(), "system": platform.platform()}
    for package in (*PACKAGES, *also):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    return versions
