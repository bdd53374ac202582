"""The command where another project's package has the name of one of sonarmap's."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-c", "import sonarmap; sonarmap.main()"]
ROOT = Path(__file__).parents[1]


def run_with_path(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command, run elsewhere than in the checkout, with a folder in PYTHONPATH before the checkout."""
    search_path = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.run(
        [*COMMAND, *arguments], cwd=folder, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": search_path}
    )


@pytest.mark.parametrize("name", ["kernels", "spectral", "slam", "tools"])
def test_a_foreign_package_is_named_with_its_place_and_the_way_out(name: str, tmp_path: Path) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").touch()
    run = run_with_path(tmp_path, "devices")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == (
        f"error: Python finds another project's `{name}` ({tmp_path / name}) before sonarmap's own ({ROOT / name}). "
        f"Remove {tmp_path} from PYTHONPATH and run the command again.\n"
    )


def test_a_foreign_module_of_one_file_is_named_too(tmp_path: Path) -> None:
    (tmp_path / "tools.py").touch()
    run = run_with_path(tmp_path, "--version")
    assert run.returncode == 2
    assert f"another project's `tools` ({tmp_path / 'tools.py'})" in run.stderr


def test_a_package_installed_beside_others_is_sent_to_an_environment_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "slam").mkdir()
    (tmp_path / "slam" / "__init__.py").touch()
    run = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = [{str(tmp_path)!r}]; {COMMAND[-1]}", "--version"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 2
    assert run.stderr.endswith("Install sonarmap in an environment of its own, for example with `pipx install .`.\n")


def test_a_folder_of_the_name_without_python_files_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "tools").mkdir()
    run = run_with_path(tmp_path, "--version")
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith("sonarmap ")
