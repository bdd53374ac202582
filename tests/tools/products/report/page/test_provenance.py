"""Titles and settings in words."""

import numpy as np
import pytest

from sonarmap.tools.products.report.page.provenance import setting_rows, title

TIMES = np.array([1_483_228_700.0, 1_483_228_790.25])  # on the last day of 2016, UTC


@pytest.mark.parametrize(
    ("inputs", "stamps", "expected"),
    [
        (["../dives/pier 3.sonar"], np.arange(6.0), "Map of pier 3.sonar, 6 scans"),
        (["scans/"], TIMES, "Map of scans, 2 scans, 2016-12-31"),
        (["a", "b"], np.array([TIMES[0], TIMES[1] + 3600]), "Map of a, b, 2 scans, 2016-12-31 to 2017-01-01"),
        (["a", "b", "x/c", "d"], np.zeros(1), "Map of a, b, c and others, 1 scan"),
        ([], np.arange(2.0), "Map of 2 scans"),
        ([], TIMES, "Map of 2 scans, 2016-12-31"),
        (["/"], np.arange(2.0), "Map of /, 2 scans"),
    ],
)
def test_titles(inputs: list[str], stamps: np.ndarray, expected: str) -> None:
    assert title(inputs, stamps) == expected


def test_settings_have_units() -> None:
    rows = setting_rows(
        {
            "inputs": ["a", "b"],
            "grid": {"edge": 96, "voxel": 0.1234567},
            "spectral": {"max_tilt": 0.5, "use_strength": False},
            "mapper": {"limits": {"turn_rate": 0.25, "speed": None}, "bridge": 3},
        }
    )
    assert rows == [
        ("inputs", "a, b"),
        ("grid.edge", "96 voxels"),
        ("grid.voxel", "0.123457 m"),
        ("spectral.max_tilt", "0.5 rad (28.65 deg)"),
        ("spectral.use_strength", "no"),
        ("mapper.limits.turn_rate", "0.25 rad/s (14.32 deg/s)"),
        ("mapper.limits.speed", "not set"),
        ("mapper.bridge", "3"),
    ]
