"""Damaged lines: an InputError or a line that is valid, soon."""

import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.pings.line_file import read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.samples.damage.mutations import mutated
from tests.tools.files.readers.pings.datagrams import SUFFIXES, written

LONGEST = 10.0  # seconds for a file
QUICK, MANY = 5, 500


def check(line: RecordedLine) -> None:
    """Its numbers can be, and it can be placed."""
    placed = line.placed(line.origin())
    assert len(placed.world_points()) == len(line.points) > 0
    assert line.beams == line.rejected + len(line.points)
    assert line.fixes.shape == (len(line.stamps), 3)


def trial(folder: Path, suffix: str, count: int, seed: int) -> Counter[str]:
    """What became of so many damaged files."""
    content, rng, ends = written(folder, suffix).read_bytes(), np.random.default_rng(seed), Counter[str]()
    path, slowest = folder / f"damaged{suffix}", 0.0
    for _ in range(count):
        path.write_bytes(mutated(content, content, rng))
        started = time.monotonic()
        try:
            line = read_line(path, [])
        except InputError:
            ends["refused"] += 1
        else:
            check(line)
            ends["with notes" if line.notes else "as if whole"] += 1
            ends["crashed"] += any("library ended" in note for note in line.notes)
            ends["hung"] += any("did not end" in note for note in line.notes)
        slowest = max(slowest, time.monotonic() - started)
    print(f"{suffix}: {dict(ends)}, slowest {slowest:.2f} s")
    assert slowest < LONGEST
    return ends


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_damaged_lines_are_refused_or_valid(tmp_path: Path, suffix: str) -> None:
    ends = trial(tmp_path, suffix, QUICK, seed=1)
    assert ends["refused"] < QUICK
    assert ends["with notes"]


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_thousands_of_damaged_lines(tmp_path: Path, suffix: str) -> None:
    trial(tmp_path, suffix, MANY, seed=2)
