"""Scans that were given twice are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.scan_sizes import repeated_in_words, same_points
from sonarmap.tools.files.readers.scans import read_survey
from tests.samples.clutter_scans import scan, write


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


def test_a_file_that_several_paths_name_is_read_once(tmp_path: Path) -> None:
    (first, second) = write(tmp_path, a=scan(0), b=scan(1))
    (tmp_path / "link.ply").symlink_to(second)
    read = read_survey([tmp_path / "a.ply", first, tmp_path / "b.ply", tmp_path / "*.ply"])
    assert [each.name for each in read.scans] == ["a", "b"]
    assert read.repeated == (f"given more than once, and used once: {first}, {second}",)
    assert read_survey([tmp_path]).repeated != ()  # the link and its file
    assert read_survey([first, second]).repeated == ()
