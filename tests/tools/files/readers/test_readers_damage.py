"""Files cut anywhere, damaged anywhere, or garbage: refused or harmless, without a warning."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.cloud_files import POINTS, SAMPLES, STRENGTH
from tests.samples.damage.damaged_files import damage, readables
from tests.samples.damage.navigation_files import NAVIGATION_FILES

pytestmark = pytest.mark.filterwarnings("error")
NAMES = list(SAMPLES)
MOST_SECONDS, MOST_MEMORY = 5.0, 512 << 20  # for one damaged file
LINES_WITHOUT_COUNT = (".xyz", ".txt", ".csv", ".asc")


def read(folder: Path, suffix: str, content: bytes) -> Scan:
    """Always the first scan, read from a file."""
    path = folder / f"scan{suffix}"
    path.write_bytes(content)
    return read_scans([path]).scans[0]


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("sample", [name for name in NAMES if name != "sonar"])
def test_a_file_cut_anywhere_is_refused(tmp_path, sample):
    suffix, content = SAMPLES[sample]
    for kept in range(len(content)):
        try:
            scan = read(tmp_path, suffix, content[:kept])
        except InputError:
            continue
        assert suffix in LINES_WITHOUT_COUNT, f"cut to {kept} of {len(content)} bytes"
        assert content[:kept].endswith((b"\r", b"\n"))
        np.testing.assert_array_equal(scan.points, POINTS[: len(scan.points)])
        np.testing.assert_array_equal(scan.strength, STRENGTH[: len(scan.points)])


class TestDamageOfEveryKindOfFile:
    """Scans, trajectories, graphs, priors, settings and journals; damaged as mutations.py has it."""

    @pytest.mark.parametrize(("count", "seed"), [(400, 2), pytest.param(10_000, 1, marks=pytest.mark.slow)])
    def test_all_are_refused_or_harmless(self, tmp_path: Path, count: int, seed: int) -> None:
        outcome = damage(tmp_path, count // len(readables()), seed)
        assert outcome.faults == []
        assert sum(ends["refused"] > 0 for ends in outcome.ends.values()) > 0.9 * len(outcome.ends)
        assert sum(outcome.ends[kind]["read"] for kind in NAVIGATION_FILES) > 0
        assert outcome.longest[0] < MOST_SECONDS
        assert outcome.largest[0] < MOST_MEMORY
