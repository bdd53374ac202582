"""Headings and cells of any length take a time in proportion to it: some of these took minutes, or hours."""

from collections.abc import Callable
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.cells import degrees
from sonarmap.tools.files.readers.navigation.clocks.times import time_of_day
from sonarmap.tools.files.readers.navigation.headings import column_of, zone_of
from sonarmap.tools.files.readers.navigation.read import read_navigation
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS
from tests.samples.processor_time import quick

LONG = 100_000


@pytest.mark.parametrize(
    "read",
    [
        lambda: column_of(0, "a" + " " * LONG + "(" + " " * LONG + "x"),
        lambda: column_of(0, " " * LONG + "[" * LONG),
        lambda: column_of(0, "a" + "_" * LONG + "." * LONG + "b "),
        lambda: column_of(0, "a_" * LONG),
        lambda: column_of(0, "depth" + " " * LONG + "(m)"),
        lambda: zone_of("utc" + " " * LONG + "x"),
        lambda: degrees("1" + " " * LONG + "x", "lat_deg"),
        lambda: degrees("1" + " -:" * LONG + "x", "lat_deg"),
        lambda: degrees("1." + "1" * LONG + "x", "lat_deg"),
        lambda: time_of_day("9:30" + " " * LONG + "x"),
    ],
)
def test_headings_and_cells(read: Callable[[], object]) -> None:
    with quick():  # what takes a tenth of a second would take minutes, were it growing by squares
        read()


@pytest.mark.parametrize(
    "cell", ["2026" + " " * LONG + "x", "T" * LONG, "2" + "T " * (LONG // 2) + "9", "a" + " " * LONG + "UT"]
)
def test_times(cell: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"time,depth_m,depth_sigma_m\n{cell},2,3\n")
    with (
        quick(),
        pytest.raises(InputError, match=r"line 2: the time is '.{1,45}'; wanted finite seconds, or a time as"),
    ):
        read_navigation(tmp_path / "log.csv", AS_IT_SAYS, None, np.zeros(1), [])


def test_tables_of_many_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each might be a misspelled one of ours; only those that may be are compared letter by letter."""
    compared: list[float] = []
    ratio = SequenceMatcher.ratio
    monkeypatch.setattr(SequenceMatcher, "ratio", lambda self: compared.append(ratio(self)) or compared[-1])
    headings = ",".join(f"a{k}_m" for k in range(1000))
    (tmp_path / "log.csv").write_text(f"time,depth,{headings},heding_deg\n1,2\n")
    with pytest.raises(InputError, match="'heding_deg' is nearly called heading_deg"):
        read_navigation(tmp_path / "log.csv", AS_IT_SAYS, None, np.zeros(1), [])
    assert len(compared) < 20
