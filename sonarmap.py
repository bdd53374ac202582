"""The top-level module of sonarmap: the `sonarmap` command."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path

_HOME = Path(__file__).resolve().parent
_PACKAGES = ("kernels", "spectral", "slam", "tools")  # common names, which another project may use too


def main() -> None:
    """The `sonarmap` command; exit code 2 where Python finds another project's package in place of sonarmap's own."""
    problem = _foreign_package()
    if problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(2)
    from tools.cli.main import run

    run()


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
