"""Peaks equal those of a NumPy search of the whole volume; known sub-voxel shifts and hard cases."""

import numpy as np
import pytest

from sonarmap.kernels.pomf.peak import find_peaks
from tests.samples.pomf_twin import highest_maxima


def bump(shape, center, deviation, height=1.0):
    grids = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    squared = sum(((grid - c + n / 2) % n - n / 2) ** 2 for grid, c, n in zip(grids, center, shape, strict=True))
    return height * np.exp(-squared / (2 * deviation**2))


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize("shape", [(16, 16, 16), (9, 5, 13), (18, 18, 18)])
@pytest.mark.parametrize("count", [1, 40])
def test_equals_the_twin_on_noise(device, shape, count):
    """In a slice at any offset, such as correlations of a grid of 18 voxels, which are 23328 bytes apart."""
    volume = np.random.default_rng(count).normal(size=shape).astype(np.float32)
    peaks = find_peaks(device, device.to_device(np.stack([1 + volume, volume]))[1], count, separation=2)
    assert [peak.index.tolist() for peak in peaks] == highest_maxima(volume, count, 2)
    assert peaks[0].value == volume.max()
    for peak in peaks:
        np.testing.assert_allclose([peak.mean, peak.std], [volume.mean(), volume.std()], atol=1e-6)
        assert peak.psr == pytest.approx((peak.top - volume.mean()) / volume.std(), rel=1e-5)
        assert peak.top >= peak.value
        window = np.ix_(*((c + np.arange(-1, 2)) % n for c, n in zip(peak.index, shape, strict=True)))
        np.testing.assert_array_equal(peak.neighborhood, volume[window])


@pytest.mark.parametrize("limits", [(3, None, None), (None, 2, 5), (4.9, 3, 6), (None, None, 0)])
def test_limits_equal_the_twin(device, limits):
    volume = np.random.default_rng(4).normal(size=(16, 16, 24)).astype(np.float32)
    peaks = find_peaks(device, device.to_device(volume), 5, separation=1, limits=limits)
    bounds = np.array([np.inf if limit is None else limit for limit in limits])
    assert [peak.index.tolist() for peak in peaks] == highest_maxima(volume, 5, 1, bounds)


@pytest.mark.parametrize("deviation", [0.7, 1.4])
@pytest.mark.parametrize("shift", [(-5.3, 2.4, 30.15), (4.5, -3, 10.7)])
def test_shift_and_height_of_a_gaussian_between_the_voxels(device, deviation, shift):
    volume = bump((32, 16, 64), shift, deviation, height=7.0).astype(np.float32)
    peak = find_peaks(device, device.to_device(volume))[0]
    np.testing.assert_allclose(peak.shift, shift, atol=0.02)
    off = shift - np.round(shift)
    assert peak.value == pytest.approx(7.0 * np.exp(-np.square(off).sum() / (2 * deviation**2)), rel=1e-4)
    # neighbors below 5 % of the voxel count as 5 %
    assert peak.top == pytest.approx(7.0, rel=1e-4 if deviation > 0.8 else 0.06)


def test_two_peaks_in_one_row_and_a_shoulder_that_is_no_peak(device):
    shape = (16, 16, 64)
    volume = bump(shape, (3, 4, 10), 2.5) + bump(shape, (3, 4, 40), 1, 0.8) + bump(shape, (15, 0, 63), 1, 0.5)
    peaks = find_peaks(device, device.to_device(volume.astype(np.float32)), 3)
    assert [tuple(peak.index) for peak in peaks] == [(3, 4, 10), (3, 4, 40), (15, 0, 63)]
    np.testing.assert_allclose(peaks[2].shift, [-1, 0, -1], atol=0.01)


def test_slope_at_the_limits_is_no_peak_and_a_constant_has_no_psr(device):
    volume = (bump((16, 16, 16), (6, 0, 0), 2) + bump((16, 16, 16), (1, 1, 1), 1, 0.3)).astype(np.float32)
    (peak,) = find_peaks(device, device.to_device(volume), limits=(3, None, None))
    assert tuple(peak.index) == (1, 1, 1)
    peaks = find_peaks(device, device.to_device(np.full((16, 16, 16), 0.5, np.float32)), 2)
    assert [peak.psr for peak in peaks] == [0, 0]
    large = (1000 + 0.01 * np.random.default_rng(9).normal(size=(32, 32, 32))).astype(np.float32)
    (peak,) = find_peaks(device, device.to_device(large))
    assert peak.std == pytest.approx(large.astype(np.float64).std(), rel=2e-3)
