"""The documentation as a site: it builds without a warning, has no dead link, and needs no other machine."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
def test_every_page_is_there(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    pages |= {Path(name) for name in ("index.html", "changelog.html", "license.html", "api/index.html")}
    assert not [page for page in sorted(pages) if not (site / page).exists()]


@pytest.mark.slow
def test_every_public_name_is_described(site: Path) -> None:
    import sonarmap

    api = "".join(path.read_text() for path in (site / "api").glob("*.html"))
    assert not [
        name for name in sonarmap.__all__ if not re.search(rf'id="[\w.]+\.{name}" class="doc doc-heading"', api)
    ]


@pytest.mark.slow
def test_nothing_is_loaded_from_other_machines(site: Path) -> None:
    assert not [page for page in site.rglob("*.html") if LOADED.search(page.read_text())]


@pytest.mark.parametrize("link", ["missing.md", "page.md#no-such-heading"])
def test_a_dead_link_is_refused(link: str, tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="pip install -e '.[docs]'")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/page.md").write_text(f"# A page\n\n[somewhere]({link})\n")
    short = f"INHERIT: {ROOT / '.mkdocs.yml'}\ndocs_dir: docs\nhooks: []\nplugins: []\nnav: [page.md]\n"
    (tmp_path / "mkdocs.yml").write_text(short)
    ended = build(tmp_path / "mkdocs.yml", tmp_path / "site")
    assert ended.returncode == 1
    assert link.partition("#")[2] in ended.stderr
    assert "page.md" in ended.stderr
