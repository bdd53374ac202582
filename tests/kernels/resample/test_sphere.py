"""Samples of a magnitude spectrum equal scipy.ndimage's (relative L2 within 5e-5); laws of the unwraps."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from sonarmap.kernels.resample.layers import (
    rectangular_unwrap,
    rotational_unwrap,
    sample,
    upload_directions,
    valid_pixels,
)
from tests.samples.pomf_twin import relative_error


def magnitude_of(edge, seed=0):
    """The centered half magnitude of a random real volume, and the whole one, float32."""
    volume = np.random.default_rng(seed).normal(size=(edge, edge, edge)) + 0.1
    whole = np.fft.fftshift(np.abs(np.fft.fftn(volume))).astype(np.float32)
    half = np.fft.fftshift(np.abs(np.fft.rfftn(volume)), axes=(0, 1)).astype(np.float32)
    return half, whole


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("edge", [16, 64])
@pytest.mark.parametrize(
    "directions",
    [rotational_unwrap(24), rectangular_unwrap(16, "x"), rectangular_unwrap(32, "y")],
    ids=["rotational", "rectangular x", "rectangular y"],
)
@pytest.mark.parametrize("degrees", [None, (130, 40, -75)])
def test_equals_scipy_on_the_whole_spectrum(device, edge, directions, degrees):
    half, whole = magnitude_of(edge)
    R = np.eye(3) if degrees is None else Rotation.from_euler("ZYX", degrees, degrees=True).as_matrix()
    radii = np.linspace(0, edge / 2 - 1.01, 7)
    k = radii[:, None, None, None] * (directions.astype(np.float64) @ R.T) + edge / 2
    want = map_coordinates(whole, np.moveaxis(k, -1, 0), order=1, output=np.float64)
    want *= valid_pixels(directions)
    magnitude, table = device.to_device(half), upload_directions(device, directions)
    got = sample(device, magnitude, table, radii, None if degrees is None else R).get()
    assert relative_error(got, want) <= 5e-5


def images(device, table, R, edge=64):
    """One layer, sampled without and with R."""
    half, _ = magnitude_of(edge, seed=3)
    directions, radii = upload_directions(device, table), np.array([0.37 * edge])
    magnitude = device.to_device(half)
    return tuple(sample(device, magnitude, directions, radii, turn).get()[0] for turn in (None, R))


def test_yaw_rotates_the_rotational_unwrap(device):
    edge, psi = 32, np.pi / 2
    table = rotational_unwrap(edge)
    plain, turned = images(device, table, Rotation.from_euler("z", psi).as_matrix())
    # I_R(v) = I(Rz(90 degrees) v), and Rz(90 degrees) (v_x, v_y) = (-v_y, v_x)
    v = np.arange(1, edge) - edge // 2
    vx, vy = np.meshgrid(v, v, indexing="ij")
    center = edge // 2
    got = turned[center + vx, center + vy]
    want = plain[center - vy, center + vx]
    assert relative_error(got, want) < 1e-4


def test_pitch_shifts_the_unwrap_with_poles_on_y_and_roll_the_one_on_x(device):
    edge, m = 32, 5
    step = m * np.pi / edge
    plain, turned = images(device, rectangular_unwrap(edge, "y"), Rotation.from_euler("y", step).as_matrix())
    assert relative_error(turned[: edge - m], plain[m:]) < 1e-4
    # beyond the edge it continues, mirrored in the other axis
    assert relative_error(turned[edge - m :, 1:], plain[:m, :0:-1]) < 1e-4
    plain, turned = images(device, rectangular_unwrap(edge, "x"), Rotation.from_euler("x", step).as_matrix())
    assert relative_error(turned[:, m:], plain[:, : edge - m]) < 1e-4


def test_directions_are_unit_vectors_of_the_upper_hemisphere():
    for table in (rectangular_unwrap(16, "x"), rectangular_unwrap(16, "y")):
        np.testing.assert_allclose(np.linalg.norm(table, axis=-1), 1, atol=1e-6)
        assert table[..., 2].min() > -1e-6
    table = rotational_unwrap(16)
    valid = valid_pixels(table)
    assert valid[0, 0] == 0
    assert valid[0, 8] == 1
    np.testing.assert_allclose(table[8, 8], [0, 0, 1])
    np.testing.assert_allclose(np.linalg.norm(table, axis=-1), valid, atol=1e-6)
