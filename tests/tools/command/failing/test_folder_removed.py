"""The output folder, or its journal, is removed while a command runs: a clear error, and no partial results."""

import shutil
from collections.abc import Callable
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.samples.clutter_scans import files_in, refused, sonarmap

GRID = ("--grid", "64")
Removal = Callable[[Path], None]
Patch = pytest.MonkeyPatch


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "above" / "out"


def folder(out: Path) -> None:
    shutil.rmtree(out)


def journal(out: Path) -> None:
    (out / "journal.sqlite").unlink()


def a_file_instead(out: Path) -> None:
    shutil.rmtree(out)
    out.write_text("mine")


def before(patch: Patch, function: str, remove: Callable[[], None]) -> None:
    """Call `remove` before the first call of a function, given as module:name."""
    module, name = function.split(":")
    *parts, name = name.split(".")
    place: Any = reduce(getattr, parts, import_module(module))
    original, waiting = getattr(place, name), [remove]

    def wrapped(*args: Any, **options: Any) -> Any:
        if waiting:
            waiting.pop()()
        return original(*args, **options)

    patch.setattr(place, name, wrapped)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("remove", [folder, journal, a_file_instead])
def test_removal_while_saving(out: Path, scans: list[str], remove: Removal, monkeypatch: Patch) -> None:
    before(monkeypatch, "sonarmap.slam.execute.journal:Journal.add", lambda: remove(out))
    result = sonarmap("map", *scans, "-o", out, *GRID, "--json")
    refused(result, f"{out / 'journal.sqlite'} was removed or replaced while this run was using it", "again")
    assert not out.is_dir() or files_in(out) == {}


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("verb", "function"),
    [
        ("map", "sonarmap.tools.products.output.folder:write_json"),  # after the first files
        ("map", "sonarmap.tools.command.verbs.map:_write_report_and_exports"),  # after the last
        ("simulate", "sonarmap.tools.lab.simulate.folder:write_tum"),
    ],
)
@pytest.mark.parametrize("remove", [folder, a_file_instead])
def test_removal_while_writing(
    out: Path, scans: list[str], remove: Removal, verb: str, function: str, monkeypatch: Patch
) -> None:
    before(monkeypatch, function, lambda: remove(out))
    arguments = (*scans[:2], *GRID, "--json") if verb == "map" else ("--scene", "pool", "--scans", "2")
    refused(sonarmap(verb, *arguments, "-o", out), "error: ", str(out))
    assert not out.is_dir() or files_in(out) == {}
    assert remove is folder or out.read_text() == "mine"
