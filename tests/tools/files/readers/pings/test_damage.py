"""Damaged lines: an InputError or a line that is valid, soon, and without much memory."""

import resource
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.pings.line_file import read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.samples.damage.mutations import mutated
from tests.samples.places import DATA
from tests.tools.files.readers.pings.datagrams import SUFFIXES, written
from tests.tools.files.readers.pings.kmall_file import kmall as kmall_file
from tests.tools.files.readers.pings.samples import LINE

LONGEST = 5.0  # seconds for a file
MOST_MEMORY = 300_000  # KiB for all of them
QUICK, MANY = 5, 500
QUICK_KMALL, MANY_KMALL = 100, 2000
REAL = DATA / "real" / "kongsberg"


def check(line: RecordedLine) -> None:
    """Its numbers can be, and it can be placed."""
    placed = line.placed(line.origin())
    assert len(placed.world_points()) == len(line.points) > 0
    assert line.beams == line.rejected + len(line.points)
    assert line.fixes.shape == (len(line.stamps), 3)


def trial(folder: Path, suffix: str, count: int, seed: int, others: Sequence[bytes] = ()) -> Counter[str]:
    """How reading `count` damaged files ended; they are made from a good file and from `others` in turns."""
    contents, rng, ends = [written(folder, suffix).read_bytes(), *others], np.random.default_rng(seed), Counter[str]()
    path, slowest, memory = folder / f"damaged{suffix}", 0.0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(count):
        content = contents[k % len(contents)]
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
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
    print(f"{suffix}: {dict(ends)}, slowest {slowest:.2f} s, {memory:,} KiB")
    assert slowest < LONGEST
    assert memory < MOST_MEMORY
    return ends


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_damaged_lines_are_refused_or_valid(tmp_path: Path, suffix: str) -> None:
    ends = trial(tmp_path, suffix, QUICK, seed=1)
    assert ends["refused"] < QUICK
    assert ends["with notes"]


def test_damaged_split_pings_are_refused_or_valid(tmp_path: Path) -> None:
    ends = trial(tmp_path, ".kmall", QUICK_KMALL, 3, [kmall_file(LINE, parts=3)])
    assert ends["refused"] < QUICK_KMALL / 2


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_thousands_of_damaged_lines(tmp_path: Path, suffix: str) -> None:
    kmall = suffix == ".kmall"
    others = [kmall_file(LINE, parts=3), *(path.read_bytes() for path in sorted(REAL.glob("*.kmall")))] if kmall else []
    trial(tmp_path, suffix, MANY_KMALL if kmall else MANY, 2, others)
