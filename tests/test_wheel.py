"""The wheel: its files, and its use in a fresh environment."""

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

from tests.samples.places import ROOT
from tests.test_architecture import libraries, modules_of, parse

PACKAGE = ROOT / "sonarmap"
SUFFIXES = {".py", ".pyi", ".cl", ".json", ".typed", ".html", ".css", ".js"}
SOURCES = ("pyproject.toml", "README.md", "LICENSE")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that nothing is left in the checkout, and with the setuptools of this environment, so that
    nothing is downloaded."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(PACKAGE, folder / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
    for source in SOURCES:
        shutil.copy(ROOT / source, folder)
    pip = [sys.executable, "-m", "pip", "wheel", "-q", ".", "--no-deps", "--no-build-isolation", "-w", "dist"]
    subprocess.run(pip, cwd=folder, check=True)
    return next((folder / "dist").glob("sonarmap-*.whl"))


def test_every_kind_of_file_is_packaged() -> None:
    """Kinds are suffixes of file names; the shell scripts of tools/ are not packaged."""
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["*"]
    suffixes = {Path(name).suffix for name in packaged} | {".typed", ".py"}
    assert suffixes == SUFFIXES
    others = {path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert not [path for path in others if path.suffix not in {*SUFFIXES, ".sh"}]


def test_the_version_is_the_same_everywhere() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    newest = next(line for line in (ROOT / "CHANGELOG.md").read_text().splitlines() if line.startswith("## "))
    assert newest.split()[1] == version


@pytest.mark.slow
def test_the_wheel_holds_the_package_with_its_kernels_and_nothing_else(wheel: Path) -> None:
    expected = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob("*") if path.suffix in SUFFIXES}
    assert {"sonarmap/py.typed", "sonarmap/__init__.pyi"} <= expected
    assert any(name.endswith(".cl") for name in expected)
    with ZipFile(wheel) as archive:
        actual = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert actual == expected


@pytest.mark.slow
def test_every_imported_library_is_a_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = [*project["dependencies"], *chain.from_iterable(project["optional-dependencies"].values())]
    declared = {re.split(r"[\[>=]", requirement)[0].replace("_", "-") for requirement in requirements}
    distributions = packages_distributions()
    missing = set()
    modules = set[str]().union(*(modules_of(parse(path)) for path in PACKAGE.rglob("*.py")))
    for library in libraries(modules) - {PACKAGE.name, *sys.stdlib_module_names}:
        names = {name.replace("_", "-") for name in distributions.get(library, [library])}
        if not names & declared:
            missing.add(library)
    assert not missing


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_wheel_maps_in_a_fresh_environment_and_simulates_with_the_lab_extra(wheel: Path, tmp_path: Path) -> None:
    """The working folder holds other packages named as subpackages of sonarmap."""
    environment = {name: text for name, text in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    for name in ("tools", "kernels"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"raise SystemExit('the {name} of another project')\n")

    def run(*command: str | Path, code: int = 0) -> str:
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    run(sys.executable, "-m", "venv", "env")
    python, sonarmap = tmp_path / "env/bin/python", tmp_path / "env/bin/sonarmap"
    run(python, "-m", "pip", "install", "-q", wheel, "-c", ROOT / "constraints.txt")
    assert run(python, "-c", "import sonarmap; print(sonarmap.Scan, sonarmap.__file__)").endswith(
        f"{tmp_path}/env/lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages/sonarmap/__init__.py\n"
    )
    assert "works" in run(sonarmap, "devices")
    simulate = ("simulate", "--scene", "floodgate", "--scans", "3", "--seed", "1", "-o", "again")
    run(sys.executable, "-m", "sonarmap", *simulate[:-1], "scans")
    run(sonarmap, "map", "scans", "--grid", "64", "-o", "map", "--export", "laz,geojson", "--origin", "60.39,5.32")
    assert (tmp_path / "map/map.ply").stat().st_size > 10_000
    assert len((tmp_path / "map/trajectory.tum").read_text().splitlines()) >= 3
    assert (tmp_path / "map/report.html").is_file()
    for verb in (simulate, ("bench",)):
        refused = run(sonarmap, *verb, code=2)
        assert "pip install 'sonarmap[lab]'" in refused
        assert "timing" not in refused  # at once, and not after a minute of kernels
    run(python, "-m", "pip", "install", "-q", f"{wheel}[lab]", "-c", ROOT / "constraints.txt")
    run(sonarmap, *simulate)
