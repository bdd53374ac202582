"""GPS time against the leap seconds of the IANA time zone database, and what counts as a time."""

import re
from datetime import UTC, datetime
from importlib import resources

import numpy as np
import pytest

from sonarmap.tools.files.time_scales import GPS_EPOCH, are_times, gps_of_utc, utc_text


def iana_leaps() -> list[float]:
    """The times since 1970 at which a leap second has just ended."""
    text = (resources.files("tzdata") / "zoneinfo" / "leapseconds").read_text()
    rows = re.findall(r"^Leap\s+(\d+)\s+(\w+)\s+(\d+)\s+23:59:60\s+\+", text, re.MULTILINE)
    days = [datetime.strptime(" ".join(row), "%Y %b %d").replace(tzinfo=UTC).timestamp() + 86_400 for row in rows]
    return [day for day in days if day > GPS_EPOCH]


def test_gps_time_counts_every_leap_second() -> None:
    leaps = iana_leaps()
    assert len(leaps) == 18
    times = np.array([*(leap - 0.5 for leap in leaps), *leaps, 1.8e9])
    ahead = [sum(time >= leap for leap in leaps) for time in times.tolist()]
    np.testing.assert_array_equal(gps_of_utc(times) - (times - GPS_EPOCH), ahead)


@pytest.mark.parametrize(
    ("stamps", "times"),
    [([1.7e9, 1.7e9 + 3], True), ([0.0, 1.0], False), ([1.7e9, 3.0], False), ([1.7e18], False), ([np.nan], False)],
)
def test_which_stamps_are_times(stamps: list[float], times: bool) -> None:
    assert are_times(np.array(stamps)) == times


def test_text() -> None:
    assert utc_text(1_483_228_790.25) == "2016-12-31T23:59:50.250000Z"
