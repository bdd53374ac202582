"""Shifts within boxes, also beyond half of the grid. `test_correlator.py` compares peaks with NumPy."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.spectrum import Pomf, whiten
from sonarmap.spectral.translation import Box, Translation

EDGE = 32
EXPONENTS = (1.0, 0.5)
R = Rotation.from_euler("ZYX", [0.9, -0.2, 0.3])  # R_target_source
ALONE = Rotation.concatenate([R])
FAR = [20, 3, -4]


@pytest.fixture(scope="module")
def translation(device: Device) -> Translation:
    return Translation(device, EDGE, EXPONENTS)


@pytest.fixture(scope="module")
def far(device: Device) -> tuple[Any, Any]:
    """Two grids of one place, the source turned and shifted by 20 voxels along x, cyclically 12 the other way."""
    rng = np.random.default_rng(2)
    cells = np.argwhere(rng.uniform(size=(52, 32, 32)) < 0.02)
    points = cells - 16 + rng.uniform(-0.3, 0.3, cells.shape)  # well inside their voxels
    pomf = Pomf(device, (EDGE, EDGE, EDGE))

    def volume(points: np.ndarray, turn: Rotation) -> SimpleNamespace:
        held = turn.apply(points[(np.abs(points) < EDGE / 2 - 0.5).all(axis=1)])
        on_device = device.to_device(np.column_stack([held, np.ones(len(held))]).astype(np.float32))
        spectrum = pomf.transform(voxelize(device, on_device, EDGE))
        return SimpleNamespace(points=on_device, spectra=tuple(whiten(device, spectrum, each) for each in EXPONENTS))

    return volume(points, Rotation.identity()), volume(points - FAR, R.inv())


@pytest.mark.parametrize("center", [[18, 5, -3]])
def test_a_shift_beyond_half_the_grid_is_not_wrapped(translation, far, center):
    free = translation.find_within(*far, ALONE, [None], 1, 2.0)
    np.testing.assert_allclose(free.peaks[0].shift, [FAR[0] - EDGE, *FAR[1:]], atol=0.5)
    box = Box(np.array(center, float), np.array([3.0, 2.5, 4.0]))
    boxed = translation.find_within(*far, ALONE, [box], 1, 2.0)
    assert boxed.exponent.tolist() == [0, 1]
    np.testing.assert_allclose(boxed.peaks.shift, [FAR, FAR], atol=0.5)


def test_all_shifts_lie_in_their_box(translation: Translation, far: tuple[Any, Any]) -> None:
    """The peak's voxel is inside; interpolation adds half a voxel at most."""
    center, half = np.array([-11.0, 4.0, 13.0]), np.array([4.0, 2.2, 5.0])
    found = translation.find_within(*far, ALONE, [Box(center, half)], 6, 1.0)
    assert (np.bincount(found.exponent) > 1).all()
    assert (np.abs(found.peaks.shift - center) <= np.floor(half) + 0.5).all()


def test_the_height_at_a_shift_is_that_of_the_first_exponent(translation: Translation, far: tuple[Any, Any]) -> None:
    (peak,) = translation.find_at(*far, ALONE, np.array([[-11.8, 3.4, -4.1]])).read()
    highest = translation.find(*far, R)[0]
    np.testing.assert_array_equal(peak.index, highest.index)
    assert peak.value == pytest.approx(highest.value)


def test_a_box_as_large_as_the_grid_bounds_nothing(translation: Translation, far: tuple[Any, Any]) -> None:
    box = Box(np.array([7.0, 0, 0]), np.array([3.0, 3.0, EDGE / 2]))
    assert not translation.is_bounded(box)
    assert not translation.is_bounded(None)
    found = translation.find_within(*far, Rotation.concatenate([R, R]), [box, None], 3, 2.0)
    for exponent in range(len(EXPONENTS)):
        np.testing.assert_array_equal(found.of(0, exponent).shift, found.of(1, exponent).shift)
