"""Broken installations and machines, as other processes see them."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from tests.samples.places import ROOT

COMMAND = [sys.executable, "-c", "from sonarmap.tools.command.start import start; start()"]


def sonarmap(
    *arguments: str,
    first: Path | None = None,
    limit: str = "",
    within: Sequence[str] = (),
    variables: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own.

    The modules of the folder `first` come before those that are installed; `limit` is that of `ulimit`, as "-v 500000";
    `within` is a command that runs the one behind it.
    """
    search_path = os.pathsep.join([*([str(first)] if first else []), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": search_path, "COLUMNS": "80", **(variables or {})}
    command = [*within, *COMMAND, *arguments]
    if limit:
        command = ["sh", "-c", f'ulimit {limit}; exec "$@"', "sh", *command]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment, timeout=200, check=False)


def broken_module(folder: Path, name: str, error: str) -> Path:
    """A folder with a package of this name that cannot be imported."""
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text(f"raise {error}\n")
    return folder


def without_drivers(folder: Path, loader: bool = True) -> Path:
    """A folder with a copy of PyOpenCL that brings no driver of its own, and perhaps no loader."""
    spec = find_spec("pyopencl")
    assert spec is not None
    assert spec.origin is not None
    left_out = ("libpocl*", "*.icd") if loader else (".libs",)
    shutil.copytree(Path(spec.origin).parent, folder / "pyopencl", ignore=shutil.ignore_patterns(*left_out))
    return folder


def has_own_loader() -> bool:
    """Whether PyOpenCL brings a loader, as its wheels do."""
    spec = find_spec("pyopencl")
    return spec is not None and spec.origin is not None and (Path(spec.origin).parent / ".libs").is_dir()
