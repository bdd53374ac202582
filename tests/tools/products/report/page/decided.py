"""Pages in which a user decides, of scans with names that are hard to write down, and the files that they save."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

from sonarmap.tools.files.csv_cell import plain_text
from sonarmap.tools.products.report.page.content import Content
from tests.tools.products.report.page.browser import Opened
from tests.tools.products.report.page.known_map import written

NAMES = ("a,b", 'say "hi"', "two\nlines", "#first", " blanks ", "grün 深い", "bad\udcff", "plain")
AS_WRITTEN = tuple(map(plain_text, NAMES))


def path_of(content: Content, to: Path, **changes: Any) -> Path:
    return written(replace(content, shown=content.shown | {"names": list(NAMES)} | changes), to / "report.html")


def saved(page: Opened, kind: str, to: Path, button: str = "#{} .save") -> list[dict[str, str]]:
    """The rows of the file that a button saves, as Python's csv reads them, without the comment."""
    with page.page.expect_download() as download:
        page.page.locator(button.format(kind)).click()
    assert download.value.suggested_filename == f"{kind}.csv"
    download.value.save_as(to / f"{kind}.csv")
    content = (to / f"{kind}.csv").read_bytes().decode("utf-8")
    comment, rest = content.split("\n", 1)
    assert comment.startswith("# ")
    assert "Map of 8 scans" in comment
    return list(csv.DictReader(rest.splitlines(keepends=True), strict=True))
