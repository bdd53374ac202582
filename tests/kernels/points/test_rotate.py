"""Rotating a volume against scipy.ndimage (relative L2 within 5e-5), and what rotations must do."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from kernels.errors import InputError
from kernels.points.rotate import rotate
from kernels.points.voxelize import voxelize


def twin(volume, R):
    edge = volume.shape[0]
    x = np.indices(volume.shape).reshape(3, -1) - edge / 2
    source = R.T @ x + edge / 2
    return map_coordinates(volume.astype(np.float64), source, order=1, cval=0).reshape(volume.shape)


def error(got, want):
    return np.linalg.norm(got - want) / np.linalg.norm(want)


def blobs(edge, R, deviations=(0.05, 0.09, 0.06)):
    """A smooth volume of three anisotropic blobs, turned by R: out(x) = volume(R^T x), analytically."""
    x = (np.indices((edge,) * 3).reshape(3, -1) - edge / 2) / edge
    y = R.T @ x
    volume = np.zeros(y.shape[1])
    places = ((0.1, -0.05, 0.02), 1.0), ((-0.12, 0.06, 0.08), 0.7), ((0.0, 0.13, -0.1), 0.5)
    for center, height in places:
        squared = (y - np.array(center)[:, None]) / np.array(deviations)[:, None]
        volume += height * np.exp(-(squared**2).sum(axis=0) / 2)
    return volume.reshape((edge,) * 3).astype(np.float32)


@pytest.mark.parametrize("edge", [16, 32, 64])
@pytest.mark.parametrize("degrees", [(31, -12, 7), (-170, 60, 100), (0.01, 0, 0)])
def test_equals_scipy(device, edge, degrees):
    volume = np.random.default_rng(edge).normal(size=(edge,) * 3).astype(np.float32)
    R = Rotation.from_euler("ZYX", degrees, degrees=True).as_matrix()
    got = rotate(device, device.to_device(volume), R).get()
    want = twin(volume, R)
    # in double precision a position may be on the other side of the grid's edge, where the volume ends
    apart = np.abs(got - want) > 1e-3
    assert apart.sum() <= edge
    assert error(got[~apart], want[~apart]) <= 5e-5


def test_the_identity_changes_nothing(device):
    volume = np.random.default_rng(1).normal(size=(16, 16, 16)).astype(np.float32)
    got = rotate(device, device.to_device(volume), np.eye(3)).get()
    np.testing.assert_allclose(got, volume, atol=1e-6)


def test_quarter_turns_permute_the_voxels(device):
    volume = np.random.default_rng(2).normal(size=(16, 16, 16)).astype(np.float32)
    R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x to y
    got = rotate(device, device.to_device(volume), R).get()
    v = np.arange(1, 16) - 8
    x, y = np.meshgrid(v, v, indexing="ij")
    np.testing.assert_allclose(got[8 - y, 8 + x], volume[8 + x, 8 + y], atol=1e-6)
    assert not got[0].any()  # would come from index 16


def test_there_and_back(device):
    R = Rotation.from_euler("ZYX", [25, 11, -18], degrees=True).as_matrix()
    volume = blobs(64, np.eye(3))
    there = rotate(device, device.to_device(volume), R)
    assert error(there.get(), blobs(64, R)) < 0.02
    assert error(rotate(device, there, R.T).get(), volume) < 0.04


def test_the_magnitude_turns_with_the_volume(device):
    """b(x) = a(R x) has |B|(k) = |A|(R k); rotate with R^T makes b of a."""
    edge = 64
    R = Rotation.from_euler("ZYX", [25, 11, -18], degrees=True).as_matrix()
    a = device.to_device(blobs(edge, np.eye(3)))
    b = rotate(device, a, R.T)
    A, B = (np.fft.fftshift(np.abs(np.fft.fftn(volume.get()))) for volume in (a, b))
    k = np.indices(A.shape).reshape(3, -1) - edge / 2
    turned = map_coordinates(A, R @ k + edge / 2, order=3).reshape(A.shape)
    assert error(B, turned) < 0.06  # the fringes between the blobs are few bins wide
    wrong = map_coordinates(A, R.T @ k + edge / 2, order=3).reshape(A.shape)
    assert error(B, wrong) > 0.2


def test_turns_points_as_voxelize_does(device):
    R = Rotation.from_euler("ZYX", [40, -20, 10], degrees=True).as_matrix()
    points = device.to_device(np.array([[9, -4, 3, 1]], np.float32))
    moved = np.argwhere(voxelize(device, points, 32, R).get())[0]
    turned = rotate(device, voxelize(device, points, 32), R).get()
    assert np.abs(np.argwhere(turned)[np.argmax(turned[turned > 0])] - moved).max() <= 1


def test_refuses_what_it_cannot_use(device):
    volume = device.empty((16, 16, 16))
    with pytest.raises(InputError, match="in place"):
        rotate(device, volume, np.eye(3), out=volume)
    with pytest.raises(InputError, match="rotation"):
        rotate(device, volume, np.zeros((3, 3)))
    with pytest.raises(InputError, match="volume is"):
        rotate(device, device.empty((16, 16, 8)), np.eye(3))
