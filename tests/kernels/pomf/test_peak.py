"""Peaks against a NumPy search of the whole volume, with known sub-voxel shifts and hard cases."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from sonarmap.kernels.pomf.peak import find_peaks
from tests.samples.refusals import refuses


def signed(index, shape):
    return [i if i < (n + 1) // 2 else i - n for i, n in zip(index, shape, strict=True)]


def twin(volume, count, separation, limits=(np.inf, np.inf, np.inf)):
    """Every local maximum of the cyclic volume, highest first, greedily kept."""
    maxima = np.argwhere(volume == maximum_filter(volume, 3, mode="wrap"))
    order = np.argsort([-volume[tuple(index)] for index in maxima], kind="stable")
    kept = []
    for index in maxima[order]:
        distance = np.abs([signed((index - other) % volume.shape, volume.shape) for other in kept])
        near = bool(len(kept)) and bool((distance.max(axis=1) <= separation).any())
        if not near and (np.abs(signed(index, volume.shape)) <= limits).all():
            kept.append(index)
    return [tuple(index) for index in kept[:count]]


def bump(shape, center, deviation, height=1.0):
    grids = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    squared = sum(((grid - c + n / 2) % n - n / 2) ** 2 for grid, c, n in zip(grids, center, shape, strict=True))
    return height * np.exp(-squared / (2 * deviation**2))


@pytest.mark.parametrize("shape", [(16, 16, 16), (7, 20, 32), (9, 5, 13), (1, 32, 64)])
@pytest.mark.parametrize("count", [1, 6, 40])
def test_equals_the_twin_on_noise(device, shape, count):
    volume = np.random.default_rng(count).normal(size=shape).astype(np.float32)
    peaks = find_peaks(device, device.to_device(volume), count, separation=2)
    assert [tuple(peak.index) for peak in peaks] == twin(volume, count, 2)
    assert peaks[0].value == volume.max()
    for peak in peaks:
        np.testing.assert_allclose([peak.mean, peak.std], [volume.mean(), volume.std()], atol=1e-6)
        assert peak.psr == pytest.approx((peak.top - volume.mean()) / volume.std(), rel=1e-5)
        assert peak.top >= peak.value
        i, j, k = peak.index
        window = np.ix_(*((c + np.arange(-1, 2)) % n for c, n in zip((i, j, k), shape, strict=True)))
        np.testing.assert_array_equal(peak.neighborhood, volume[window])


@pytest.mark.parametrize("shape", [(18, 18, 18), (7, 20, 32), (9, 5, 13)])
def test_a_slice_may_begin_anywhere(device, shape):
    """As the correlations of a grid of 18 voxels do, 23328 bytes apart."""
    volumes = np.random.default_rng(2).normal(size=(3, *shape)).astype(np.float32)
    there = device.to_device(volumes)
    for volume, part in zip(volumes, there, strict=True):
        peaks = find_peaks(device, part, 3, separation=2)
        assert [tuple(peak.index) for peak in peaks] == twin(volume, 3, 2)
        assert peaks[0].psr == find_peaks(device, device.to_device(volume), 3, separation=2)[0].psr


@pytest.mark.parametrize("limits", [(3, None, None), (None, 2, 5), (4.9, 3, 6), (None, None, 0)])
def test_limits_equal_the_twin(device, limits):
    volume = np.random.default_rng(4).normal(size=(16, 16, 24)).astype(np.float32)
    peaks = find_peaks(device, device.to_device(volume), 5, separation=1, limits=limits)
    bounds = [np.inf if limit is None else limit for limit in limits]
    assert [tuple(peak.index) for peak in peaks] == twin(volume, 5, 1, bounds)


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.5, 0.0, -0.3), (-0.45, 0.4, 0.5)])
def test_top_is_the_height_between_the_voxels(device, shift):
    volume = bump((32, 16, 64), np.array([4.0, -3.0, 11.0]) + shift, 0.9, height=7.0).astype(np.float32)
    peak = find_peaks(device, device.to_device(volume))[0]
    assert peak.top == pytest.approx(7.0, rel=1e-4)
    assert peak.value == pytest.approx(7.0 * np.exp(-np.square(shift).sum() / (2 * 0.9**2)), rel=1e-4)


@pytest.mark.parametrize("deviation", [0.7, 1.4])
def test_sub_voxel_shift_of_a_gaussian(device, deviation):
    shape, shift = (32, 16, 64), np.array([-5.3, 2.4, 30.15])
    volume = bump(shape, shift, deviation).astype(np.float32)
    (peak,) = find_peaks(device, device.to_device(volume))
    np.testing.assert_allclose(peak.shift, shift, atol=0.02)


def test_sub_voxel_shift_of_an_unblurred_correlation(device):
    n, shift = 32, np.array([3.25, -7.3, 0.2])
    f = np.fft.fftfreq(n)
    spectrum = np.exp(-2j * np.pi * (f[:, None, None] * shift[0] + f[:, None] * shift[1] + f * shift[2]))
    volume = np.fft.ifftn(spectrum).real.astype(np.float32)
    (peak,) = find_peaks(device, device.to_device(volume))
    np.testing.assert_allclose(peak.shift, shift, atol=0.1)


def test_two_peaks_in_one_row_and_a_shoulder_that_is_none(device):
    shape = (16, 16, 64)
    volume = bump(shape, (3, 4, 10), 2.5) + bump(shape, (3, 4, 40), 1, 0.8) + bump(shape, (15, 0, 63), 1, 0.5)
    peaks = find_peaks(device, device.to_device(volume.astype(np.float32)), 3)
    assert [tuple(peak.index) for peak in peaks] == [(3, 4, 10), (3, 4, 40), (15, 0, 63)]
    np.testing.assert_allclose(peaks[2].shift, [-1, 0, -1], atol=0.01)


def test_the_separation_is_cyclic(device):
    volume = np.zeros((16, 16, 16), np.float32)
    volume[0, 0, 0], volume[14, 15, 0], volume[8, 8, 8] = 3, 2, 1
    indices = [tuple(peak.index) for peak in find_peaks(device, device.to_device(volume), 2, separation=2)]
    assert indices == [(0, 0, 0), (8, 8, 8)]


def test_a_slope_into_the_limits_is_no_peak(device):
    volume = (bump((16, 16, 16), (6, 0, 0), 2) + bump((16, 16, 16), (1, 1, 1), 1, 0.3)).astype(np.float32)
    (peak,) = find_peaks(device, device.to_device(volume), limits=(3, None, None))
    assert tuple(peak.index) == (1, 1, 1)


def test_the_deviation_of_a_correlation_with_a_large_mean(device):
    volume = (1000 + 0.01 * np.random.default_rng(9).normal(size=(32, 32, 32))).astype(np.float32)
    (peak,) = find_peaks(device, device.to_device(volume))
    assert peak.std == pytest.approx(volume.astype(np.float64).std(), rel=2e-3)


def test_a_constant_correlation_has_no_psr(device):
    peaks = find_peaks(device, device.to_device(np.full((16, 16, 16), 0.5, np.float32)), 2)
    assert [peak.psr for peak in peaks] == [0, 0]


def test_refuses_what_it_cannot_use(device):
    volume = np.zeros((16, 16, 16), np.float32)
    volume[3, 4, 5] = np.nan
    refuses("not finite", find_peaks, device, device.to_device(volume))
    good = device.to_device(np.zeros((16, 16, 16), np.float32))
    refuses("count", find_peaks, device, good, 0)
    refuses("limits", find_peaks, device, good, limits=(1, -1, None))
    refuses("`correlation` is float64", find_peaks, device, device.to_device(np.zeros((4, 4, 4))))
