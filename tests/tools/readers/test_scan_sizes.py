"""A scan in millimeters among scans in meters is named; scans that only differ are not."""

import numpy as np
import pytest

from spectral.scan import Scan
from tools.readers.scan_sizes import strange_sizes


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
