"""What a scan refuses, and what it says about it."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior, Scan

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


@pytest.mark.parametrize("given", [{"points": POINTS.tolist()}, {"points": None}, {"strength": [1.0] * 4}])
@pytest.mark.parametrize("more", [{}, {"viewpoints": POINTS.tolist()}])
def test_what_is_no_array(given: dict[str, Any], more: dict[str, Any]) -> None:
    name, value = next(iter(given.items()))
    with pytest.raises(InputError, match=f"pier: `{name}` are {type(value).__name__}; wanted an array of float32"):
        Scan(**{"points": POINTS, "name": "pier", **given, **more})
    with pytest.raises(InputError, match="scan: `viewpoints` are list; wanted an array of float32"):
        Scan(**{"points": POINTS, "viewpoints": POINTS.tolist(), **more})


@pytest.mark.parametrize("T", [None, np.eye(4), RigidTransform.identity(2)])
def test_a_prior_of_no_pose(T: Any) -> None:
    with pytest.raises(InputError, match="`T_world_sensor` is not one finite pose"):
        PosePrior(T, np.ones(6))
