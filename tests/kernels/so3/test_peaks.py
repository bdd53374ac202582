"""Local maxima of correlations over rotations equal those of SciPy's maximum filter."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from sonarmap.kernels.so3.correlation import RotationCorrelation


def twin(values):
    """The highest local maximum of each quarter of a row, highest first, and the values around each."""
    images, edge, _ = values.shape
    top = values == maximum_filter(values, 3, mode="wrap")
    maxima = []
    for b, i, quarter in np.ndindex(images - 1, edge, 4):
        part = slice(quarter * edge // 4, (quarter + 1) * edge // 4)
        row = np.where(top[b, i, part], values[b, i, part], -np.inf)
        if row.max() > -np.inf:
            maxima.append((-row.max(), b, i, part.start + int(row.argmax())))
    index = np.array([maximum[1:] for maximum in sorted(maxima)])
    around = []
    for b, i, j in index:
        rows = (
            np.clip(b + np.arange(-1, 2), 0, images - 2),
            (i + np.arange(-1, 2)) % edge,
            (j + np.arange(-1, 2)) % edge,
        )
        around.append(values[np.ix_(*rows)].ravel())
    return index, np.array(around)


def volumes(shape, seed, levels=None):
    """Noise, or integers below `levels`, so that neighbors are often equal; the last image is 0."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape) if levels is None else rng.integers(0, levels, shape)
    values[:, -1] = 0
    return values.astype(np.float32)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(("bandwidth", "largest", "parts"), [(8, 0.2, 3), (16, 1.0, 2)])
@pytest.mark.parametrize("levels", [None, 3])
def test_equals_the_twin(device, bandwidth, largest, parts, levels):
    correlation = RotationCorrelation(device, bandwidth, largest)
    values = volumes((parts, len(correlation.betas) + 1, correlation.edge, correlation.edge), parts, levels)
    correlation.peaks(device.to_device(values))
    found = correlation.peaks(device.to_device(values))  # a second search does not depend on the first
    assert len(found) == parts
    for peaks, volume in zip(found, values, strict=True):
        index, around = twin(volume)
        np.testing.assert_array_equal(peaks.index, index)
        np.testing.assert_array_equal(peaks.around, around)
        np.testing.assert_array_equal(peaks.around[:, 13], volume[tuple(index.T)])


def test_more_peaks_than_the_first_read_returns(device):
    """In constant images the first voxel of each quarter of a row is a maximum."""
    correlation = RotationCorrelation(device, 16, 0.5)
    edge = correlation.edge
    values = np.zeros((2, len(correlation.betas) + 1, edge, edge), np.float32)
    values[1, 0, 3, 5] = 1.0
    first, second = correlation.peaks(device.to_device(values))
    assert len(first.index) == 4 * edge * len(correlation.betas) > 256
    np.testing.assert_array_equal(first.index[:5], [(0, 0, 0), (0, 0, 8), (0, 0, 16), (0, 0, 24), (0, 1, 0)])
    np.testing.assert_array_equal(second.index[0], [0, 3, 5])
    assert second.around[0].tolist() == [0] * 4 + [1] + [0] * 8 + [1] + [0] * 13
