"""The best maximum of every segment, and the peak at a place, against a search of the whole volume in NumPy."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from kernels.device.device import Device
from kernels.device.launch import zero
from kernels.errors import InputError
from kernels.pomf.peak import find_peaks, peak_at, segment_peaks


def segments_twin(volume, segments):
    """The first of the highest maxima of each segment; segments highest first, then in C order."""
    is_peak = volume == maximum_filter(volume, 3, mode="wrap")
    width = volume.shape[2] // segments
    maxima = []
    for place in np.ndindex(*volume.shape[:2], segments):
        part = slice(place[2] * width, (place[2] + 1) * width)
        values = np.where(is_peak[place[0], place[1], part], volume[place[0], place[1], part], -np.inf)
        if values.max() > -np.inf:
            maxima.append((-values.max(), *place[:2], place[2] * width + int(values.argmax())))
    maxima.sort(key=lambda maximum: maximum[0])  # stable
    return np.array([maximum[1:] for maximum in maxima]), np.array([-maximum[0] for maximum in maxima])


def noise(shape, seed, levels=None):
    """Standard normal, or whole numbers below `levels`, of which many are alike."""
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) if levels is None else rng.integers(0, levels, shape)).astype(np.float32)


class TestSegmentPeaks:
    @pytest.mark.parametrize(
        ("shape", "segments"),
        [
            ((16, 16, 16), 2),
            ((7, 20, 32), 4),
            ((9, 5, 12), 3),
            ((6, 9, 40), 1),
            ((5, 6, 7), 7),
            ((1, 32, 64), 4),
            ((3, 1, 72), 4),
            ((2, 2, 8), 1),
            ((4, 4, 1), 1),
            ((4, 5, 2), 1),
            ((3, 4, 96), 2),
        ],
    )
    @pytest.mark.parametrize("levels", [None, 4])
    def test_equals_the_twin(self, device, shape, segments, levels):
        volume = noise(shape, segments, levels)
        index, values = segment_peaks(device, device.to_device(volume), segments)
        want_index, want_values = segments_twin(volume, segments)
        np.testing.assert_array_equal(values, want_values)
        np.testing.assert_array_equal(index, want_index)
        assert index.dtype == np.int64
        np.testing.assert_array_equal(values, volume[tuple(index.T)])

    def test_the_highest_is_that_of_find_peaks(self, device):
        volume = device.to_device(noise((12, 16, 32), 3))
        index, values = segment_peaks(device, volume)
        (peak,) = find_peaks(device, volume)
        np.testing.assert_array_equal(index[0], peak.index)
        assert values[0] == peak.value

    def test_a_maximum_below_zero_is_one_too(self, device):
        volume = noise((6, 8, 16), 5) - np.float32(100)
        index, values = segment_peaks(device, device.to_device(volume), 2)
        np.testing.assert_array_equal(index, segments_twin(volume, 2)[0])
        assert values.max() < -90

    def test_of_equal_voxels_each_segment_has_its_first(self, device):
        index, values = segment_peaks(device, device.to_device(np.zeros((2, 3, 16), np.float32)), 2)
        want = [(i, j, k) for i in range(2) for j in range(3) for k in (0, 8)]
        np.testing.assert_array_equal(index, want)
        assert not values.any()

    def test_a_higher_neighbor_hides_a_voxel_in_all_26_directions(self, device):
        for step in np.ndindex(3, 3, 3):
            if step == (1, 1, 1):
                continue
            volume = np.zeros((8, 8, 16), np.float32)
            # at a corner, so that the way to the neighbor may be cyclic
            volume[0, 0, 0], volume[tuple((np.array(step) - 1) % volume.shape)] = 1, 2
            index, values = segment_peaks(device, device.to_device(volume), 2)
            assert values[0] == 2
            assert (values[1:] == 0).all(), step
            assert tuple(index[0]) == tuple((np.array(step) - 1) % volume.shape)

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    def test_refuses_what_is_not_finite(self, device, bad):
        volume = noise((5, 6, 16), 6)
        for place in ((0, 0, 0), (4, 3, 15), (2, 2, 9)):
            broken = volume.copy()
            broken[place] = bad
            with pytest.raises(InputError, match="not finite"):
                segment_peaks(device, device.to_device(broken), 2)

    @pytest.mark.parametrize("segments", [0, 3, 32])
    def test_refuses_segments_that_do_not_fit(self, device, segments):
        with pytest.raises(InputError, match="do not divide rows"):
            segment_peaks(device, device.to_device(noise((4, 4, 16), 1)), segments)


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
        for got, want in zip(segment_peaks(elsewhere, there, 1), segment_peaks(device, here, 1), strict=True):
            np.testing.assert_array_equal(got, want)

    def test_zero_clears_there_too(self, elsewhere):
        array = elsewhere.to_device(np.ones((4, 1024), np.float32))
        zero(elsewhere, array)
        assert not array.get().any()
