"""What a scan refuses, and what it says about it."""

import numpy as np
import pytest

from kernels.errors import InputError
from spectral.scan import Scan

POINTS = np.arange(12, dtype=np.float32).reshape(4, 3)


def test_viewpoints_are_kept_as_they_are() -> None:
    viewpoints = POINTS + 100
    assert Scan(POINTS, viewpoints=viewpoints).viewpoints is viewpoints
    assert Scan(POINTS).viewpoints is None


@pytest.mark.parametrize(
    ("viewpoints", "message"),
    [
        (POINTS[:3], r"pier: `viewpoints` are float32 of shape \(3, 3\); wanted float32 of shape \(4, 3\)"),
        (POINTS[0], r"shape \(3,\)"),
        (POINTS.astype(np.float64), "are float64"),
        (np.where(POINTS > 7, np.nan, POINTS), "2 of 4 `viewpoints` are NaN or infinite"),
        (np.where(POINTS > 10, np.inf, POINTS), "1 of 4 `viewpoints` are NaN or infinite"),
    ],
)
def test_viewpoints_that_cannot_be_used(viewpoints: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Scan(POINTS, name="pier", viewpoints=viewpoints)
