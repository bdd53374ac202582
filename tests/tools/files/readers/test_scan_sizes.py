"""A scan in millimeters among scans in meters is named; scans that only differ are not."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.scan_sizes import strange_sizes
from sonarmap.tools.files.readers.scans import read_survey


def scans(*sizes: float) -> list[Scan]:
    rng = np.random.default_rng(4)
    return [Scan((rng.normal(size=(5000, 3)) * size).astype(np.float32)) for size in sizes]


def test_names_the_unit() -> None:
    named = strange_sizes(scans(5, 7, 6000, 4))
    assert list(named) == [2]
    assert "it was in millimeters" in named[2]
    assert "--units" in named[2]


def test_a_small_one_too() -> None:
    named = strange_sizes(scans(0.006, 7, 6, 4))
    assert list(named) == [0]
    assert "the others were in millimeters" in named[0]


@pytest.mark.parametrize("sizes", [(5, 5000), (1, 40, 9), (3,), (2, 2, 2), (0.0, 0.0, 0.0)])
def test_leaves_others_alone(sizes: tuple[float, ...]) -> None:
    assert not strange_sizes(scans(*sizes))


def test_it_is_a_gap_in_a_survey(tmp_path: Path) -> None:
    for k, scan in enumerate(scans(5, 7, 6000, 4)):
        np.save(tmp_path / f"scan_{k}.npy", scan.points)
    read = read_survey([tmp_path])
    assert [scan.name for scan in read.scans] == ["scan_0", "scan_1", "scan_3"]
    assert [scan.stamp for scan in read.scans] == [0, 1, 3]
    assert [(unread.where, unread.before) for unread in read.unread] == [(str(tmp_path / "scan_2.npy"), 2)]
    assert "scan_2.npy: its points are spread over" in read.unread[0].reason
