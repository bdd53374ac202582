"""The pages of docs/, README and CHANGELOG: files and links that they name exist."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.samples.places import ROOT

PACKAGES = ("kernels", "spectral", "slam", "tools")
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
# `FORMATS` in `tools/files/readers/file.py`, `Pair` (`slam/pair.py`), `FORMATS` in `tools/files/readers`,
# `slam.map.point_map.fuse`, `PlaceIndex`, `Translation.find`. In backticks any
# path of this repository; elsewhere, as in drawings, files of the packages and tests.
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
MOST_PAGES = 33  # a small subject is a section of the page where a reader would look for it


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def defined(pattern: str, text: str) -> bool:
    return re.search(rf"^{pattern}", text, re.MULTILINE) is not None


def absent(text: str) -> Iterator[str]:
    """What a page names that is not there."""
    for path in {*PATHS.findall(text), *FILES.findall(text)}:
        if not PLACEHOLDER.search(path) and not (ROOT / path).exists():
            yield path
    for name, file in IN_FILE.findall(text):
        if not defined(rf"((class|def) {name}\b|{name}\b.* =)", (ROOT / file).read_text()):
            yield f"{name} in {file}"
    for name, folder in IN_FOLDER.findall(text):
        if not any(defined(rf"{name}\b.* =", path.read_text()) for path in (ROOT / folder).rglob("*.py")):
            yield f"{name} in {folder}"
    for name in MODULES.findall(text):
        module, _, member = name.strip(".").rpartition(".")
        file = (ROOT / module.replace(".", "/")).with_suffix(".py")
        if not file.exists() or not defined(rf"(def|class) {member}\b", file.read_text()):
            yield name
    for name, method in CLASSES.findall(text):
        sources = [source for source in SOURCES if defined(rf"class {name}\b", source)]
        if name not in FOREIGN and not any(not method or f"def {method}(" in source for source in sources):
            yield f"{name}.{method}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_what_is_named_is_there(page: Path) -> None:
    assert not [*absent(page.read_text())]


def test_what_is_not_there_is_found() -> None:
    names = "tools/nowhere.py", "gone in slam/pair.py", "GONE in tools/files/readers", "slam.pair.gone"
    page = "`{}`; `gone` in `slam/pair.py`; `GONE` in `tools/files/readers`; `{}`; `PlaceIndex.gone`; `GoneClass`"
    assert {*absent(page.format(names[0], names[3]))} == {*names, "PlaceIndex.gone", "GoneClass."}


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


def test_the_readme_is_short_and_there_are_few_pages() -> None:
    assert len(list((ROOT / "docs").rglob("*.md"))) <= MOST_PAGES
    lines = (ROOT / "README.md").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("<!--")]) < README_LINES


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
