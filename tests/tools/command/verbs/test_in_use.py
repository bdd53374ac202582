"""`sonarmap view`, and a map's folder that another run uses: refused with what to do, and nothing is lost."""

import webbrowser
from pathlib import Path

import pytest

from sonarmap.tools.files.writers.atomic import locked
from tests.samples.clutter_scans import done, files_in, refused, said, scan, sonarmap, write
from tests.tools.products.export.finished import finished_map

MCAP = ("--format", "mcap", "--quiet")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    write(tmp_path / "scans", scan_0=scan(0), scan_1=scan(1))
    return finished_map(tmp_path / "out")


def commands(out: Path) -> dict[str, tuple[str | Path, ...]]:
    return {
        "map": ("map", out.parent / "scans", "-o", out, "--grid", "64"),
        "view": ("view", out, "--rebuild", "--no-open"),
        "export into it": ("export", out, "-o", out, *MCAP),
        "export of another into it": ("export", out.parent / "other", "-o", out, *MCAP),
        "export from it": ("export", out, "-o", out.parent / "gis", *MCAP),
    }


@pytest.mark.parametrize("verb", commands(Path()))
def test_while_another_writes_to_it_all_are_refused(out: Path, verb: str) -> None:
    finished_map(out.parent / "other")
    before = files_in(out)
    with locked(out, writing=True):
        result = sonarmap(*commands(out)[verb])
    refused(result, f"{out} is in use: another run of sonarmap is writing to it", "Wait until it has ended")
    assert files_in(out) == before
    assert not (out.parent / "gis").exists()


@pytest.mark.parametrize("verb", ["view", "export into it", "export from it"])
def test_while_another_reads_it_only_readers_are_let_in(out: Path, verb: str) -> None:
    with locked(out, writing=False):
        result = sonarmap(*commands(out)[verb])
    assert (result.exit_code == 0) == (verb == "export from it")
    assert sonarmap(*commands(out)[verb]).exit_code == 0


def test_a_report_is_opened_whoever_uses_the_folder(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    (out / "report.html").write_text("it")
    with locked(out, writing=True):
        assert sonarmap("view", out).exit_code == 0


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that a browser was asked to open."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address) or True)
    return addresses


def test_it_writes_and_opens_the_report(tmp_path: Path, asked: list[str]) -> None:
    out = finished_map(tmp_path / "out ü #1")
    refused(sonarmap("view", out), "has no report.html", "--rebuild")
    written = sonarmap("view", out, "--rebuild", "--no-open")
    assert (written.exit_code, asked) == (0, [])
    assert (out / "report.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    done(sonarmap("view", out))
    assert asked == [(out / "report.html").as_uri()]
    assert asked[0].endswith("out%20%C3%BC%20%231/report.html")


def test_it_writes_anew(tmp_path: Path, asked: list[str]) -> None:
    out = finished_map(tmp_path / "out")
    (out / "report.html").write_text("old")
    assert sonarmap("view", out).exit_code == 0
    assert (out / "report.html").read_text() == "old"
    assert sonarmap("view", out, "--rebuild").exit_code == 0
    assert (out / "report.html").read_text(encoding="utf-8") != "old"
    assert len(asked) == 2


@pytest.mark.parametrize("options", [(), ("--rebuild",)])
def test_what_is_no_map_is_refused(tmp_path: Path, asked: list[str], options: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    for name in ("file", "empty", "missing"):
        refused(sonarmap("view", tmp_path / name, *options), str(tmp_path / name), "`sonarmap map` wrote")
    assert asked == []


def test_without_a_browser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    out = finished_map(tmp_path / "out")
    result = sonarmap("view", out, "--rebuild")
    assert result.exit_code == 2
    said(result, "no browser can be opened here", "report.html")
    assert (out / "report.html").exists()
