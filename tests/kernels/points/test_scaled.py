"""Points on a grid of other voxels."""

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.points.scaled import scaled


@pytest.mark.parametrize("count", [0, 1, 255, 256, 1001])
def test_places_are_scaled_and_weights_stay(device, count):
    points = np.random.default_rng(count).normal(size=(count, 4)).astype(np.float32)
    given = device.to_device(points)
    got = scaled(device, given, 0.3).get()
    np.testing.assert_allclose(got, points * np.array([0.3, 0.3, 0.3, 1.0], np.float32), rtol=1e-6)
    np.testing.assert_array_equal(given.get(), points)


def test_refuses_other_points(device):
    with pytest.raises(InputError, match="`points` is"):
        scaled(device, device.empty((5, 3)), 0.5)
