"""Axes and units of the points in files, with numbers worked by hand."""

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.corrections import FRAMES, UNITS, PointFrame

# 5 m ahead, 2 m to starboard, 1 m below the sensor, as each convention writes it; ned: the sensor looks North
AHEAD_RIGHT_BELOW = {"flu": (5, -2, -1), "frd": (5, 2, 1), "rdf": (2, 1, 5), "ned": (5, 2, 1)}


@pytest.mark.parametrize("axes", FRAMES)
def test_axes(axes: str) -> None:
    wanted = (2, 5, -1) if axes == "ned" else (5, -2, -1)  # East, North, Up; or forward, left, up
    cloud = Cloud(np.array([AHEAD_RIGHT_BELOW[axes]], np.float32), viewpoints=np.array([AHEAD_RIGHT_BELOW[axes]]))
    turned = PointFrame(axes).turned(cloud)
    np.testing.assert_array_equal(turned.points, [wanted])
    assert turned.viewpoints is not None
    np.testing.assert_array_equal(turned.viewpoints, [wanted])
    np.testing.assert_allclose(np.linalg.det(FRAMES[axes]), 1)  # no convention mirrors


@pytest.mark.parametrize(
    ("unit", "meters"), [("m", 1), ("cm", 0.01), ("mm", 0.001), ("ft", 0.3048), ("us-ft", 0.30480061)]
)
def test_units(unit: str, meters: float) -> None:
    turned = PointFrame("flu", unit).turned(Cloud(np.array([[1000.0, -2000, 3000]])))
    np.testing.assert_allclose(turned.points, [[1000 * meters, -2000 * meters, 3000 * meters]], rtol=1e-8)
    assert unit in UNITS


def test_integers_and_what_is_not_finite() -> None:
    turned = PointFrame("frd", "mm").turned(Cloud(np.array([[1500, 250, -750]], np.int16)))
    np.testing.assert_allclose(turned.points, [[1.5, -0.25, 0.75]])
    points = PointFrame("ned").turned(Cloud(np.array([[np.nan, 1.0, 2.0], [1, np.inf, 3]]))).points
    np.testing.assert_array_equal(np.isfinite(points), [[True, False, True], [False, True, True]])


def test_the_default_changes_nothing() -> None:
    cloud = Cloud(np.array([[1, 2, 3]], np.int16))
    assert PointFrame().turned(cloud) is cloud


@pytest.mark.parametrize("given", [("enu", "m"), ("flu", "inch"), ("", "m")])
def test_refuses_other_names(given: tuple[str, str]) -> None:
    with pytest.raises(InputError, match="choose one of"):
        PointFrame(*given)
