"""A map of known points, its page, and the files that the page saves."""

import csv
import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.map_folder.folder import Map, read_map_folder
from sonarmap.tools.files.readers.csv_table import plain_text
from sonarmap.tools.products.report.content import Content, content_of
from sonarmap.tools.products.report.page import report_text
from sonarmap.tools.products.report.points import FRACTION
from tests.tools.products.export.finished import finished_map
from tests.tools.products.report.browser import Opened

VOXEL = 0.5
QUANTUM = VOXEL / FRACTION
A, B = np.array([1.2345, -2.3456, 0.789]), np.array([-6.54, 3.21, 2.1098])
# a valid picture: a red dot
DOT = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cfc0000003010100c9fe92ef"
    "0000000049454e44ae426082"
)


def known_points() -> np.ndarray:
    """Points (60, 3) [m]: A, B and others, more than 2 m from each other."""
    rng = np.random.default_rng(5)
    points = [A, B]
    while len(points) < 60:
        point = rng.uniform([-12, -9, -2], [14, 8, 4])
        if min(np.linalg.norm(point - other) for other in points) > 2:
            points.append(point)
    return np.array(points)


def unpack(data: bytes, layout: dict[str, Any]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (M, 3) [m] and their columns in the order of the file, as web/packed.js unpacks them."""
    tiles, sizes = layout["tiles"], layout["planes"]
    shape = 6 + sum(sizes.values()), sum(tile["count"] for tile in tiles)
    planes = np.frombuffer(gzip.decompress(data), np.uint8).reshape(shape).astype(np.uint32)
    steps = (planes[:6:2] | planes[1:6:2] << 8).astype(np.uint16)
    moved = (steps >> 1) ^ -(steps & 1)
    ends = np.cumsum([tile["count"] for tile in tiles])[:-1]
    points = [
        np.array(tile["origin"]) + layout["quantum"] * np.cumsum(differences, axis=1, dtype=np.uint16).T
        for tile, differences in zip(tiles, np.split(moved, ends, axis=1), strict=False)
    ]
    columns, at = {}, 6
    for name, size in sizes.items():
        columns[name] = (planes[at : at + size] << 8 * np.arange(size, dtype=np.uint32)[:, None]).sum(axis=0)
        at += size
    return np.concatenate([np.zeros((0, 3)), *points]), columns


def folder_of(points: np.ndarray, out: Path) -> Map:
    """Map of a ring of scans with these points; point k belongs to scan k % 8."""
    folder = read_map_folder(finished_map(out))
    k = np.arange(len(points))
    columns = {
        "count": np.ones_like(k),
        "seen": 1 + k % 4,
        "sigma": 0.01 + 0.001 * (k % 50),
        "scan": k % 8,
        "survey": np.zeros_like(k),
        "intensity": 1.0 + k % 90,
    }
    part = replace(folder.parts[0], points=points, columns=columns)
    return replace(folder, parts=(part,), voxel=VOXEL)


def written(content: Content, path: Path) -> Path:
    path.write_text(report_text(content), encoding="utf-8")
    return path


def known_content(out: Path) -> Content:
    """Page content of the known points, with two pictures."""
    return replace(content_of(folder_of(known_points(), out)), pictures={"map.png": DOT, "map_2.png": DOT})


NAMES = ("a,b", 'say "hi"', "two\nlines", "#first", " blanks ", "grün 深い", "bad\udcff", "plain")
AS_WRITTEN = tuple(map(plain_text, NAMES))


def path_of(content: Content, to: Path, **changes: Any) -> Path:
    return written(replace(content, shown=content.shown | {"names": list(NAMES)} | changes), to / "report.html")


def saved(page: Opened, kind: str, to: Path) -> list[dict[str, str]]:
    """The rows of the file that a button saves, as Python's csv reads them, without the comment."""
    with page.page.expect_download() as download:
        page.page.locator(f"#{kind} .save").click()
    assert download.value.suggested_filename == f"{kind}.csv"
    download.value.save_as(to / f"{kind}.csv")
    content = (to / f"{kind}.csv").read_bytes().decode("utf-8")
    comment, rest = content.split("\n", 1)
    assert comment.startswith("# ")
    assert "Map of 8 scans" in comment
    return list(csv.DictReader(rest.splitlines(keepends=True), strict=True))
