"""Scans that do not go with the others: in millimeters among scans in meters, or given twice."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.scan_sizes import repeated_in_words, same_points, strange_sizes
from sonarmap.tools.files.readers.scans import read_survey


def scans(*sizes: float) -> list[Scan]:
    rng = np.random.default_rng(4)
    return [Scan((rng.normal(size=(5000, 3)) * size).astype(np.float32)) for size in sizes]


@pytest.mark.parametrize(
    ("sizes", "strange", "words"),
    [((5, 7, 6000, 4), 2, "it was in millimeters"), ((0.006, 7, 6, 4), 0, "the others were in millimeters")],
)
def test_names_the_unit(sizes: tuple[float, ...], strange: int, words: str) -> None:
    named = strange_sizes(scans(*sizes))
    assert list(named) == [strange]
    assert words in named[strange]
    assert "--units" in named[strange]


@pytest.mark.parametrize("sizes", [(5, 5000), (1, 40, 9), (3,), (2, 2, 2), (0.0, 0.0, 0.0)])
def test_leaves_others_alone(sizes: tuple[float, ...]) -> None:
    assert not strange_sizes(scans(*sizes))


def test_it_is_a_gap_in_a_survey(tmp_path: Path) -> None:
    for k, one in enumerate(scans(5, 7, 6000, 4)):
        np.save(tmp_path / f"scan_{k}.npy", one.points)
    read = read_survey([tmp_path])
    assert [each.name for each in read.scans] == ["scan_0", "scan_1", "scan_3"]
    assert [each.stamp for each in read.scans] == [0, 1, 3]
    assert [(unread.where, unread.before) for unread in read.unread] == [(str(tmp_path / "scan_2.npy"), 2)]
    assert "scan_2.npy: its points are spread over" in read.unread[0].reason


def cloud(seed: int, name: str = "", count: int = 300) -> Scan:
    points = np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)
    return Scan(points=points, name=name or f"scan_{seed}", stamp=float(seed))


def test_only_exactly_the_same_points_are_a_copy() -> None:
    nearly = cloud(1, "nearly")
    points = nearly.points.copy()
    points[-1, 2] += 1e-3  # behind what is compared first
    scans = [cloud(1), cloud(2), replace(nearly, points=points), cloud(1, "copy"), cloud(1, "shorter", 299)]
    assert same_points([*scans, cloud(2, "other"), cloud(1, "again")]) == [(0, 3), (1, 5), (0, 6)]


def test_in_words() -> None:
    assert repeated_in_words([], [cloud(1), cloud(2)]) == []
    scans = [cloud(1), *(cloud(1, f"copy_{k}") for k in range(7))]
    files, copies = repeated_in_words([Path("a.ply"), Path("b.ply")], scans)
    assert files == "given more than once, and used once: a.ply, b.ply"
    assert copies.startswith("the same points twice: copy_0 of scan_1, copy_1 of scan_1, ")
    assert "copy_4 of scan_1 and 2 more; leave the copies out" in copies
