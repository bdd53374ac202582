"""Files, classes and links named in docs/, README and CHANGELOG exist."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.commands.pages import named
from tests.samples.places import ROOT

PACKAGES = ("kernels", "spectral", "slam", "tools")
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
# In backticks any path of this repository; elsewhere, as in drawings, files of the packages and tests.
PATHS = re.compile(r"`((?:kernels|spectral|slam|tools|tests|docs|\.ci)/[\w./-]*|[\w-]+\.(?:py|toml|sh))`")
FILES = re.compile(r"\b(?:kernels|spectral|slam|tools|tests)/[\w./-]+\.(?:py|cl|sh)\b")
LINKS = re.compile(r"\]\((?!https?:)([^)\s]+)\)")
PLACEHOLDER = re.compile(r"NAME|ROOM")  # of a file that the reader is to make
CLASSES = re.compile(r"`([A-Z][a-z]+[A-Z]\w*|[A-Z][a-z]+(?=\.))(?:\.(\w+))?[`(]")
SOURCES = [path.read_text() for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
FOREIGN = {"BetweenFactorPose3", "RigidTransform"}  # GTSAM's, SciPy's


def defined(pattern: str, text: str) -> bool:
    return re.search(rf"^{pattern}", text, re.MULTILINE) is not None


def absent(text: str) -> Iterator[str]:
    """Paths and classes that a page names but that do not exist."""
    for path in {*PATHS.findall(text), *FILES.findall(text)}:
        if not PLACEHOLDER.search(path) and not (ROOT / path).exists():
            yield path
    for name, method in CLASSES.findall(text):
        sources = [source for source in SOURCES if defined(rf"class {name}\b", source)]
        if name not in FOREIGN and not any(not method or f"def {method}(" in source for source in sources):
            yield f"{name}.{method}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_named_paths_and_classes_exist(page: Path) -> None:
    assert not [*absent(page.read_text())]


def test_missing_paths_and_classes_are_reported() -> None:
    page = "`tools/nowhere.py`; `PlaceIndex.gone`; `GoneClass`"
    assert {*absent(page)} == {"tools/nowhere.py", "PlaceIndex.gone", "GoneClass."}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_targets_of_links_exist(page: Path) -> None:
    missing = []
    for link in LINKS.findall(page.read_text()):
        file, _, heading = link.partition("#")
        target = page.parent / file if file else page
        if not target.exists() or (heading and heading not in headings(target)):
            missing.append(link)
    assert not missing


def headings(page: Path) -> set[str]:
    """The anchors of a page, as GitHub makes them of its headings."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def test_every_page_is_reachable_from_the_readme() -> None:
    reached: set[Path] = set()
    waiting = [ROOT / "README.md"]
    while waiting:
        new = linked_from(waiting.pop()) - reached
        reached |= new
        waiting += [page for page in new if page.suffix == ".md"]
    assert set(PAGES) - reached <= {ROOT / "README.md"}
    assert set((ROOT / "docs").glob("*.md")) <= linked_from(ROOT / "README.md")


def linked_from(page: Path) -> set[Path]:
    return {(page.parent / link.partition("#")[0]).resolve() for link in LINKS.findall(page.read_text())}
