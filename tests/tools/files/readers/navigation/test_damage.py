"""Damaged logs of instruments: refused or harmless, quickly and in little memory."""

from pathlib import Path

import pytest

from tests.samples.damage.damaged_files import damage
from tests.samples.damage.navigation_files import OF_INSTRUMENTS

pytestmark = pytest.mark.filterwarnings("error")
MOST_SECONDS, MOST_MEMORY = 5.0, 300 << 20  # for one damaged file


@pytest.mark.parametrize("kind", OF_INSTRUMENTS)
@pytest.mark.parametrize("count", [25, pytest.param(5_000, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])])
def test_damaged_logs_are_refused_or_harmless(tmp_path: Path, kind: str, count: int) -> None:
    outcome = damage(tmp_path, count, count, {kind: OF_INSTRUMENTS[kind]})
    assert outcome.faults == []
    assert outcome.ends[kind]["refused"] + outcome.ends[kind]["read"] == count
    assert outcome.longest[0] < MOST_SECONDS
    assert outcome.largest[0] < MOST_MEMORY
