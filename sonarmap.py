# pyright: strict
"""Noisy 3D sonar scans in, a consistent map out: the names that a program needs, and the `sonarmap` command.

    import sonarmap
    registration = sonarmap.register(target, source)  # two (N, 3) arrays of points [m]
    result = sonarmap.map_scans("scans/")

Names only: the functions are in tools/api.py, the classes in kernels/, spectral/ and slam/. Each is loaded when it is
first used, so that the command starts at once.
"""

import os
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kernels import *  # noqa: F403
    from slam import *  # noqa: F403
    from spectral import *  # noqa: F403
    from tools.api import *  # noqa: F403

_HOME = Path(__file__).resolve().parent
_PACKAGES = ("kernels", "spectral", "slam", "tools")  # common names, which another project may use too
_PUBLIC = ("tools.api", "slam", "spectral", "kernels")  # modules whose `__all__` is sonarmap's


def __getattr__(name: str) -> Any:
    """The public name, from the module that has it."""
    if name.startswith("_") and name != "__all__":
        raise AttributeError(name)
    if problem := _foreign_package():
        raise ImportError(problem)
    if name == "__all__":
        return sorted({public for module in _PUBLIC for public in import_module(module).__all__})
    for module in _PUBLIC:
        if name in import_module(module).__all__:
            return getattr(import_module(module), name)
    raise AttributeError(f"sonarmap has no {name!r}; dir(sonarmap) lists its names")


def __dir__() -> list[str]:
    return sorted({"main", *(public for module in _PUBLIC for public in import_module(module).__all__)})


def main() -> None:
    """The `sonarmap` command; exit code 2 where Python finds another project's package in place of sonarmap's own."""
    problem = _foreign_package()
    if problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(2)
    try:
        from tools.cli.main import run
    except Exception as error:  # noqa: BLE001 - a broken library can raise anything
        sys.exit(_without_a_library(error))
    run()


def _without_a_library(error: Exception) -> int:
    """The exit code where a library of the command line itself is missing or broken: `doctor` can do without."""
    if sys.argv[1:2] == ["doctor"]:
        from tools.doctor.run import run_from

        return run_from(sys.argv[2:], error)
    reason = f"{type(error).__name__}: {error}"
    print(f"error: the command cannot start: {reason}. 'sonarmap doctor' says what is missing.", file=sys.stderr)
    return 2


def _foreign_package() -> str | None:
    """Which package Python would import from elsewhere than beside this file, and what to do about it."""
    for name in _PACKAGES:
        spec = find_spec(name)
        if spec is None:
            return f"sonarmap's package `{name}` is missing in {_HOME}; install sonarmap again"
        folders = spec.submodule_search_locations
        actual = Path([*(folders or ()), spec.origin or name][0]).resolve()
        if actual != _HOME / name:
            return (
                f"Python finds another project's `{name}` ({actual}) before sonarmap's own ({_HOME / name}). "
                + _way_out(actual.parent)
            )
    return None


def _way_out(folder: Path) -> str:
    search_path = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if folder in [Path(entry).resolve() for entry in search_path]:
        return f"Remove {folder} from PYTHONPATH and run the command again."
    return "Install sonarmap in an environment of its own, for example with `pipx install .`."
