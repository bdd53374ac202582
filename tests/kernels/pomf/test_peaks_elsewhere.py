"""Peaks on a device whose memory is not the host's."""

import numpy as np
import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import zero
from sonarmap.kernels.pomf.peak import find_peaks


class TestAwayFromTheHost:
    """A device whose memory is not read in place gives the same."""

    @pytest.fixture
    def elsewhere(self, device):
        other = Device(device.cl_device)
        other.__dict__["is_cpu"] = False
        return other

    @pytest.mark.parametrize("shape", [(7, 20, 32), (9, 5, 13)])
    def test_peaks_are_the_same(self, device, elsewhere, shape):
        volume = np.random.default_rng(11).normal(size=shape).astype(np.float32)
        there, here = elsewhere.to_device(volume), device.to_device(volume)
        pairs = zip(find_peaks(elsewhere, there, 9), find_peaks(device, here, 9), strict=True)
        for got, want in pairs:
            np.testing.assert_array_equal(got.shift, want.shift)
            np.testing.assert_array_equal(got.neighborhood, want.neighborhood)
            assert (got.value, got.top, got.psr) == (want.value, want.top, want.psr)

    def test_zero_clears_there_too(self, elsewhere):
        array = elsewhere.to_device(np.ones((4, 1024), np.float32))
        zero(elsewhere, array)
        assert not array.get().any()
