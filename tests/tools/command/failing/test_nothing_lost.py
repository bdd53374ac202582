"""Failures while results are written or printed: earlier results stay whole, and no partial results are left."""

import resource
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest

from sonarmap.tools.products.output import folder as output_folder
from tests.samples.clutter_scans import files_in, refused, sonarmap
from tests.samples.command_line import SONARMAP
from tests.samples.places import ROOT

GRID = ("--grid", "64")
RESULTS = {"map.ply", "map_all.ply", "map.png", "trajectory.tum", "graph.g2o", "graph.json"}
RESULTS |= {"pairs.csv", "summary.json", "times.json", "report.html"}


@pytest.fixture(scope="module")
def mapped(scans: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of two scans."""
    folder = tmp_path_factory.mktemp("mapped")
    assert sonarmap("map", *scans[:2], "-o", folder, *GRID).exit_code == 0
    return folder


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder with placeholder results of an earlier run."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name in RESULTS:
        (folder / name).write_text(f"{name} of an earlier run")
    return folder


def results_in(folder: Path) -> dict[str, bytes]:
    """All files but the journal, which keeps finished pairs even if the results cannot be written."""
    return {name: content for name, content in files_in(folder).items() if name != "journal.sqlite"}


@pytest.mark.parametrize("place", ["file/out", "odd"])  # odd has a folder for map.ply
def test_an_output_folder_that_cannot_be_written_is_refused(tmp_path: Path, scans: list[str], place: str) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "odd" / "map.ply").mkdir(parents=True)
    out = tmp_path / place
    refused(sonarmap("map", *scans[:2], "-o", out, *GRID, "--json"), f"cannot write {out}", "another output folder")
    assert (tmp_path / "file").read_text() == "mine"
    # the folder named map.ply is noticed last, after pairs are in the journal
    assert {path.name for path in (tmp_path / "odd").iterdir()} <= {"map.ply", "journal.sqlite"}


def test_the_output_folder_is_checked_before_the_work(scans: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for work in ("sonarmap.slam.mapper.Mapper.run", "sonarmap.tools.lab.simulate.simulation.simulate"):
        monkeypatch.setattr(work, lambda *_, **__: pytest.fail("worked before it looked"))
    assert sonarmap("map", *scans, "-o", Path(scans[0]) / "out", *GRID).exit_code == 2
    assert sonarmap("simulate", "-o", Path(scans[0]) / "out").exit_code == 2


@contextmanager
def small_files() -> Iterator[None]:
    """No file may grow beyond 60 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(
    ("verb", "module"),
    [("simulate", "sonarmap.tools.lab.simulate.folder"), ("map", "sonarmap.tools.products.output.folder")],
)
@pytest.mark.quick_cases(1)
def test_a_file_above_the_size_limit_leaves_earlier_results(
    out: Path, scans: list[str], verb: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Small files would fit, but must not be replaced either."""
    before = files_in(out)
    write_files = getattr(import_module(module), "_write_files")  # noqa: B009 - the type checker knows no module by its name
    # Not earlier: the OpenCL compiler ends the process if its own files exceed the limit.
    monkeypatch.setattr(f"{module}._write_files", small_files()(write_files))
    arguments = ["simulate"] if verb == "simulate" else ["map", *scans, *GRID]
    result = sonarmap(*arguments, "-o", out)
    refused(result, f"error: cannot write {out}", "File too large", "choose another output folder")
    assert results_in(out) == before


@pytest.mark.parametrize("written", ["write_ply", "write_json"])
@pytest.mark.slow
def test_ctrl_c_while_writing_leaves_earlier_results(
    out: Path, scans: list[str], mapped: Path, written: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = files_in(out)
    shutil.copy(mapped / "journal.sqlite", out)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(output_folder, written, stop)
    result = sonarmap("map", *scans[:2], "-o", out, *GRID)
    assert result.exit_code == 130
    assert results_in(out) == before


@pytest.mark.slow
def test_a_full_device_at_stdout_is_an_error(tmp_path: Path, scans: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        command = [*SONARMAP, "map", *scans[:2], *GRID, "-o", str(tmp_path)]
        ended = subprocess.run(command, cwd=ROOT, text=True, stdout=full, stderr=subprocess.PIPE)
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].startswith("error: cannot write the output: No space left on device.")
    assert "Traceback" not in ended.stderr
    assert set(results_in(tmp_path)) == RESULTS


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_closed_standard_streams_are_no_error(tmp_path: Path, scans: list[str], mapped: Path, closed: str) -> None:
    command = [*SONARMAP, "map", *scans[:2], "-o", str(tmp_path), *GRID]
    ended = subprocess.run(["sh", "-c", f'exec "$@" {closed}', "sh", *command], cwd=ROOT, capture_output=True)
    assert ended.returncode == 0
    assert b"Traceback" not in ended.stderr
    written, again = results_in(tmp_path), results_in(mapped)
    assert set(written) == RESULTS
    assert all(written[name] == again[name] for name in RESULTS - {"times.json"})
