"""The peak at a place, against a search of the volume in NumPy."""

import numpy as np
import pytest

from kernels.device.device import Device
from kernels.device.launch import zero
from kernels.errors import InputError
from kernels.pomf.peak import find_peaks, peak_at


def noise(shape, seed, levels=None):
    """Standard normal, or whole numbers below `levels`, of which many are alike."""
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) if levels is None else rng.integers(0, levels, shape)).astype(np.float32)


class TestPeakAt:
    @pytest.mark.parametrize("shape", [(16, 12, 32), (9, 5, 13), (3, 4, 16)])
    def test_equals_the_twin_at_borders_too(self, device, shape):
        volume = noise(shape, 7)
        correlation = device.to_device(volume)
        rng = np.random.default_rng(8)
        corners = [np.array(place) * np.array(shape) - np.array(place) for place in np.ndindex(2, 2, 2)]
        for index in [*corners, *rng.integers(-2 * np.array(shape), 2 * np.array(shape), (10, 3))]:
            peak = peak_at(device, correlation, index)
            around = np.stack(np.meshgrid(*(i + np.arange(-1, 2) for i in index), indexing="ij"), -1).reshape(-1, 3)
            around %= shape
            want = around[volume[tuple(around.T)].argmax()]
            np.testing.assert_array_equal(peak.index, want)
            assert peak.value == volume[tuple(want)]
            window = np.ix_(*((c + np.arange(-1, 2)) % n for c, n in zip(want, shape, strict=True)))
            np.testing.assert_array_equal(peak.neighborhood, volume[window])
            np.testing.assert_allclose([peak.mean, peak.std], [volume.mean(), volume.std()], atol=1e-6)
            assert peak.psr == pytest.approx((peak.top - volume.mean()) / volume.std(), rel=1e-5)

    def test_at_a_peak_it_is_that_of_find_peaks(self, device):
        correlation = device.to_device(noise((16, 16, 16), 9))
        for peak in find_peaks(device, correlation, 3):
            here = peak_at(device, correlation, peak.index + np.array([1, -1, 0]))
            np.testing.assert_array_equal(here.shift, peak.shift)
            assert (here.value, here.top, here.psr) == (peak.value, peak.top, peak.psr)

    def test_on_a_slope_it_stays_within_a_voxel(self, device):
        ramp = np.broadcast_to(np.arange(16, dtype=np.float32), (8, 8, 16)).copy()
        peak = peak_at(device, device.to_device(ramp), np.array([3, 4, 7]))
        assert peak.index[2] == 8
        assert peak.value == 8
        assert abs(peak.shift[2] + 8) <= 0.5  # 8 of 16 is -8

    def test_refuses_what_it_cannot_use(self, device):
        volume = noise((8, 8, 8), 10)
        correlation = device.to_device(volume)
        with pytest.raises(InputError, match="index"):
            peak_at(device, correlation, np.array([1.5, 2, 3]))
        with pytest.raises(InputError, match="index"):
            peak_at(device, correlation, np.array([1, 2]))
        volume[7, 7, 7] = np.inf
        with pytest.raises(InputError, match="not finite"):
            peak_at(device, device.to_device(volume), np.array([1, 2, 3]))


class TestAwayFromTheHost:
    """A device whose memory is not read in place gives the same."""

    @pytest.fixture
    def elsewhere(self, device):
        other = Device(device.cl_device)
        other.__dict__["is_cpu"] = False
        return other

    @pytest.mark.parametrize("shape", [(7, 20, 32), (9, 5, 13)])
    def test_peaks_are_the_same(self, device, elsewhere, shape):
        volume = noise(shape, 11)
        there, here = elsewhere.to_device(volume), device.to_device(volume)
        pairs = zip(find_peaks(elsewhere, there, 9), find_peaks(device, here, 9), strict=True)
        index = np.array([-1, 4, 40])
        for got, want in [*pairs, (peak_at(elsewhere, there, index), peak_at(device, here, index))]:
            np.testing.assert_array_equal(got.shift, want.shift)
            np.testing.assert_array_equal(got.neighborhood, want.neighborhood)
            assert (got.value, got.top, got.psr) == (want.value, want.top, want.psr)

    def test_zero_clears_there_too(self, elsewhere):
        array = elsewhere.to_device(np.ones((4, 1024), np.float32))
        zero(elsewhere, array)
        assert not array.get().any()
