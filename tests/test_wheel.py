"""The wheel: what is in it, and that it works in an environment of its own."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("kernels", "spectral", "slam", "tools")
SUFFIXES = {".py", ".pyi", ".cl", ".typed", ".html", ".css", ".js"}
SOURCES = ("sonarmap.py", "pyproject.toml", "README.md", "LICENSE")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that nothing is left in the checkout, and with the setuptools of this environment, so that
    nothing is downloaded."""
    folder = tmp_path_factory.mktemp("wheel")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    for source in SOURCES:
        shutil.copy(ROOT / source, folder)
    pip = [sys.executable, "-m", "pip", "wheel", "-q", ".", "--no-deps", "--no-build-isolation", "-w", "dist"]
    subprocess.run(pip, cwd=folder, check=True)
    return next((folder / "dist").glob("sonarmap-*.whl"))


def test_the_wheel_holds_the_packages_with_their_kernels_and_no_tests(wheel: Path) -> None:
    expected = {"sonarmap.py"}
    for package in PACKAGES:
        files = (path for path in (ROOT / package).rglob("*") if path.suffix in SUFFIXES)
        expected |= {path.relative_to(ROOT).as_posix() for path in files}
    assert {f"{package}/py.typed" for package in PACKAGES} <= expected
    assert any(name.endswith(".cl") for name in expected)
    with ZipFile(wheel) as archive:
        actual = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert actual == expected


def test_the_command_is_the_top_level_modules(wheel: Path) -> None:
    with ZipFile(wheel) as archive:
        entry_points = next(name for name in archive.namelist() if name.endswith("entry_points.txt"))
        assert archive.read(entry_points).decode().split("\n")[:2] == ["[console_scripts]", "sonarmap = sonarmap:main"]


def test_every_imported_library_is_a_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = [*project["dependencies"], *chain.from_iterable(project["optional-dependencies"].values())]
    declared = {re.split(r"[\[>=]", requirement)[0].replace("_", "-") for requirement in requirements}
    distributions = packages_distributions()
    missing = set()
    for library in imported_libraries():
        names = {name.replace("_", "-") for name in distributions.get(library, [library])}
        if not names & declared:
            missing.add(library)
    assert not missing


def imported_libraries() -> set[str]:
    """The top-level modules that the product imports and that neither it nor Python has."""
    libraries: set[str] = set()
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                libraries.update(alias.name.split(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                libraries.add(node.module.split(".")[0])
    return libraries - {*PACKAGES, *sys.stdlib_module_names}


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_wheel_maps_scans_in_an_environment_of_its_own(wheel: Path, tmp_path: Path) -> None:
    environment = {name: text for name, text in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}

    def run(*command: str | Path) -> str:
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    run(sys.executable, "-m", "venv", "env")
    python, sonarmap = tmp_path / "env/bin/python", tmp_path / "env/bin/sonarmap"
    run(python, "-m", "pip", "install", "-q", wheel, "-c", ROOT / "constraints.txt")
    assert run(python, "-c", "import kernels; print(kernels.__file__)").startswith(str(tmp_path / "env"))
    assert "works" in run(sonarmap, "devices")
    run(sonarmap, "simulate", "--scene", "floodgate", "--scans", "3", "--seed", "1", "-o", "scans")
    run(sonarmap, "map", "scans", "--grid", "64", "-o", "map")
    assert (tmp_path / "map/map.ply").stat().st_size > 10_000
    assert len((tmp_path / "map/trajectory.tum").read_text().splitlines()) >= 3
