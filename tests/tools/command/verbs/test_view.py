"""`sonarmap view` end to end, with a browser that only says what it was asked for."""

import webbrowser
from pathlib import Path

import pytest

from tests.samples.clutter_scans import done, refused, said, sonarmap
from tests.tools.products.export.finished import finished_map


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that a browser was asked to open."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address) or True)
    return addresses


def test_it_writes_and_opens_the_report(tmp_path: Path, asked: list[str]) -> None:
    out = finished_map(tmp_path / "out ü #1")
    refused(sonarmap("view", out), "has no report.html", "--write")
    written = sonarmap("view", out, "--write", "--no-open")
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
    assert sonarmap("view", out, "--write").exit_code == 0
    assert (out / "report.html").read_text(encoding="utf-8") != "old"
    assert len(asked) == 2


@pytest.mark.parametrize("options", [(), ("--write",)])
def test_what_is_no_map_is_refused(tmp_path: Path, asked: list[str], options: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    for name in ("file", "empty", "missing"):
        refused(sonarmap("view", tmp_path / name, *options), str(tmp_path / name), "`sonarmap map` wrote")
    assert asked == []


def test_without_a_browser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    out = finished_map(tmp_path / "out")
    result = sonarmap("view", out, "--write")
    assert result.exit_code == 2
    said(result, "no browser can be opened here", "report.html")
    assert (out / "report.html").exists()
