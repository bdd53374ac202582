"""The documentation site: it builds without warnings or dead links, and loads nothing from other machines."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import sonarmap
from tests.samples.places import ROOT

LOADED = re.compile(
    r"<(?:script|img|iframe)\b[^>]*\bsrc=\"?(?:https?:)?//|<link\b(?![^>]*canonical)[^>]*\bhref=\"?(?:https?:)?//"
)


def build(config: Path, site: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(config), "-d", str(site)]
    # Not --quiet: it would leave out the warnings before they are counted.
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "NO_COLOR": "1"}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="pip install -e '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    ended = build(ROOT / ".mkdocs.yml", folder)
    assert ended.returncode == 0, ended.stderr
    return folder


@pytest.mark.slow
def test_all_pages_and_public_names_exist(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    pages |= {Path(name) for name in ("index.html", "changelog.html", "license.html", "api/index.html")}
    assert not [page for page in sorted(pages) if not (site / page).exists()]
    api = "".join(path.read_text() for path in (site / "api").glob("*.html"))
    assert not [
        name for name in sonarmap.__all__ if not re.search(rf'id="[\w.]+\.{name}" class="doc doc-heading"', api)
    ]


@pytest.mark.slow
def test_nothing_is_loaded_from_other_machines(site: Path) -> None:
    assert not [page for page in site.rglob("*.html") if LOADED.search(page.read_text())]


@pytest.mark.slow
def test_dead_links_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="pip install -e '.[docs]'")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/page.md").write_text("# A page\n\n[a page](missing.md), [a heading](page.md#no-such-heading)\n")
    short = f"INHERIT: {ROOT / '.mkdocs.yml'}\ndocs_dir: docs\nhooks: []\nplugins: []\nnav: [page.md]\n"
    (tmp_path / "mkdocs.yml").write_text(short)
    ended = build(tmp_path / "mkdocs.yml", tmp_path / "site")
    assert ended.returncode == 1
    assert "missing.md" in ended.stderr
    assert "no-such-heading" in ended.stderr
