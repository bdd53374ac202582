"""The pages of docs/, README and CHANGELOG: files and links that they name exist."""

import re
from pathlib import Path

import pytest

from tests.samples.places import ROOT

PACKAGES = ("kernels", "spectral", "slam", "tools")
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
# In backticks any path of this repository; elsewhere, as in drawings, files of the packages and tests.
PATHS = re.compile(r"`((?:kernels|spectral|slam|tools|tests|docs|\.ci)/[\w./-]*|[\w-]+\.(?:py|toml|sh))`")
FILES = re.compile(r"\b(?:kernels|spectral|slam|tools|tests)/[\w./-]+\.(?:py|cl|sh)\b")
LINKS = re.compile(r"\]\((?!https?:)([^)\s]+)\)")
IN_FILE = re.compile(r"`(\w+)` (?:in |\()`([\w/.-]+\.py)`")
PLACEHOLDER = re.compile(r"NAME|ROOM")  # of a file that the reader is to make
IN_FOLDER = re.compile(r"`([A-Z_]+)` in `([\w/]+)`")
MODULES = re.compile(r"`(?:sonarmap\.)?((?:kernels|spectral|slam|tools)\.[\w.]+)")
CLASSES = re.compile(r"`([A-Z][a-z]+[A-Z]\w*|[A-Z][a-z]+(?=\.))(?:\.(\w+))?[`(]")
SOURCES = [path.read_text() for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
FOREIGN = {"BetweenFactorPose3", "RigidTransform"}  # GTSAM's, SciPy's
README_LINES = 150
MOST_PAGES = 26  # a small subject is a section of the page where a reader would look for it


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_named_paths_exist(page: Path) -> None:
    text = page.read_text()
    named = {path for path in PATHS.findall(text) + FILES.findall(text) if not PLACEHOLDER.search(path)}
    assert not [path for path in sorted(named) if not (ROOT / path).exists()]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_names_are_in_the_files_that_are_named(page: Path) -> None:
    """`FORMATS` in `tools/files/readers/file.py`, and `Pair` (`slam/pair.py`)."""
    missing = []
    for name, file in IN_FILE.findall(page.read_text()):
        definition = rf"^(class|def) {name}\b|^{name}\b.* ="
        if not re.search(definition, (ROOT / file).read_text(), re.MULTILINE):
            missing.append(f"{name} in {file}")
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_tables_are_in_the_folders_that_are_named(page: Path) -> None:
    """`FORMATS` in `tools/files/readers`."""
    missing = []
    for name, folder in IN_FOLDER.findall(page.read_text()):
        sources = [path.read_text() for path in (ROOT / folder).rglob("*.py")]
        if not any(re.search(rf"^{name}\b.* =", source, re.MULTILINE) for source in sources):
            missing.append(f"{name} in {folder}")
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_named_modules_define_what_is_named(page: Path) -> None:
    """`slam.map.point_map.fuse` is `fuse` of slam/map/point_map.py."""
    missing = []
    for name in MODULES.findall(page.read_text()):
        module, _, member = name.strip(".").rpartition(".")
        file = (ROOT / module.replace(".", "/")).with_suffix(".py")
        if not file.exists() or not re.search(rf"^(def|class) {member}\b", file.read_text(), re.MULTILINE):
            missing.append(name)
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_named_classes_have_the_named_methods(page: Path) -> None:
    """`PlaceIndex` and `Translation.find`."""
    missing = []
    for name, method in CLASSES.findall(page.read_text()):
        sources = [source for source in SOURCES if re.search(rf"^class {name}\b", source, re.MULTILINE)]
        if name not in FOREIGN and not any(not method or f"def {method}(" in source for source in sources):
            missing.append(f"{name}.{method}")
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_somewhere(page: Path) -> None:
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


def test_the_readme_is_short() -> None:
    lines = (ROOT / "README.md").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("<!--")]) < README_LINES


def test_there_are_few_pages() -> None:
    assert len(list((ROOT / "docs").rglob("*.md"))) <= MOST_PAGES


def test_the_readme_names_every_page_that_lies_directly_in_docs() -> None:
    assert set((ROOT / "docs").glob("*.md")) <= linked_from(ROOT / "README.md")


def test_every_page_is_reachable_from_the_readme() -> None:
    reached: set[Path] = set()
    waiting = [ROOT / "README.md"]
    while waiting:
        new = linked_from(waiting.pop()) - reached
        reached |= new
        waiting += [page for page in new if page.suffix == ".md"]
    assert set(PAGES) - reached <= {ROOT / "README.md"}


def linked_from(page: Path) -> set[Path]:
    return {(page.parent / link.partition("#")[0]).resolve() for link in LINKS.findall(page.read_text())}
