"""Translations with several whitenings at once, anywhere or within a box, against NumPy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.spectrum import Pomf, whiten
from sonarmap.spectral.translation import BLUR, Box, Translation
from tests.samples.pomf_twin import correlation_of, highest_maxima, occupied

EDGE = 32
EXPONENTS = (1.0, 0.5)
R = Rotation.from_euler("ZYX", [0.9, -0.2, 0.3])  # R_target_source
ALONE = Rotation.concatenate([R])


@dataclass(frozen=True, slots=True)
class Blocks:
    """Points about the grid's center, on the device and on the host, and their spectra."""

    points: Array
    spectra: tuple[Array, ...]
    on_host: np.ndarray


@pytest.fixture(scope="module")
def translation(device: Device) -> Translation:
    return Translation(device, EDGE, EXPONENTS)


@pytest.fixture(scope="module")
def blocks(device: Device) -> Callable[[np.ndarray], Blocks]:
    """Makes a volume of points (n, 3) [voxels]."""
    pomf = Pomf(device, (EDGE, EDGE, EDGE))

    def of(points: np.ndarray) -> Blocks:
        on_device = device.to_device(np.column_stack([points, np.ones(len(points))]).astype(np.float32))
        spectrum = pomf.transform(voxelize(device, on_device, EDGE))
        spectra = tuple(whiten(device, spectrum, exponent) for exponent in EXPONENTS)
        return Blocks(on_device, spectra, points)

    return of


def twin(target: Blocks, source: Blocks, exponent: float, offset: np.ndarray | None = None) -> np.ndarray:
    moved = R.apply(source.on_host) + (0 if offset is None else offset)
    return correlation_of(occupied(target.on_host, EDGE), occupied(moved, EDGE), exponent, BLUR)


def place(seed: int, low: list[float], high: list[float], density: float = 0.04) -> np.ndarray:
    """Points at random in a block of these corners [voxels], well inside their voxels."""
    rng = np.random.default_rng(seed)
    cells = np.argwhere(rng.uniform(size=np.subtract(high, low).astype(int)) < density)
    return cells + np.array(low) + rng.uniform(-0.3, 0.3, cells.shape)


def within(points: np.ndarray) -> np.ndarray:
    """Those that the grid holds."""
    return points[(np.abs(points) < EDGE / 2 - 0.5).all(axis=1)]


Pair = tuple[Blocks, Blocks]


def pair_of(blocks: Callable[[np.ndarray], Blocks], points: np.ndarray, shift: list[int]) -> Pair:
    """What two grids so far apart [voxels] hold of one place, the source turned."""
    return blocks(within(points)), blocks(R.inv().apply(within(points - np.array(shift))))


@pytest.fixture(scope="module")
def near(blocks: Callable[[np.ndarray], Blocks]) -> Pair:
    """5, -3 and 2 voxels apart, most of the place in both; a part of it beside."""
    return pair_of(blocks, place(1, [-12, -14, -10], [17, 13, 14]), [5, -3, 2])


FAR = [20, 3, -4]


@pytest.fixture(scope="module")
def far(blocks: Callable[[np.ndarray], Blocks]) -> Pair:
    """20 voxels apart along x, more than half of the grid: as 12 the other way to what is cyclic."""
    return pair_of(blocks, place(2, [-16, -16, -16], [36, 16, 16], 0.02), FAR)


class TestAnywhere:
    def test_each_correlation_is_numpys(self, translation: Translation, near: Pair, far: Pair) -> None:
        """With an offset too, where what leaves the grid takes no part."""
        for pair, offset in ((near, None), (far, np.array([18.0, 3, -4]))):
            for exponent, correlation in zip(EXPONENTS, translation.correlations(*pair, R, offset), strict=True):
                want = twin(*pair, exponent, offset)
                assert np.linalg.norm(correlation.get() - want) < 1e-4 * np.linalg.norm(want)

    def test_the_highest_peaks_are_numpys(self, translation: Translation, near: Pair) -> None:
        found = translation.find_within(*near, ALONE, [None], 4, 2.0)[0]
        assert len(found) == 2
        for exponent, peaks in zip(EXPONENTS, found, strict=True):
            correlation = twin(*near, exponent)
            voxels = highest_maxima(correlation, 4, 2.0)
            np.testing.assert_array_equal([peak.index for peak in peaks], voxels)
            np.testing.assert_allclose([peak.value for peak in peaks], correlation[tuple(np.transpose(voxels))], 1e-4)
            np.testing.assert_allclose(peaks[0].shift, [5, -3, 2], atol=0.5)

    def test_a_box_as_large_as_the_grid_bounds_nothing(self, translation: Translation, near: Pair) -> None:
        box = Box(np.array([7.0, 0, 0]), np.array([3.0, 3.0, EDGE / 2]))
        assert not translation.is_bounded(box)
        assert not translation.is_bounded(None)
        boxed, free = translation.find_within(*near, Rotation.concatenate([R, R]), [box, None], 3, 2.0)
        for some, all_of_them in zip(boxed, free, strict=True):
            np.testing.assert_array_equal([p.shift for p in some], [p.shift for p in all_of_them])

    def test_the_first_exponents_is_that_of_one_alone(self, translation: Translation, near: Pair) -> None:
        alone = Translation(translation.device, EDGE)
        first = Blocks(near[0].points, near[0].spectra[:1], near[0].on_host)
        np.testing.assert_array_equal(
            alone.correlations(first, near[1], R)[0].get(), translation.correlations(*near, R)[0].get()
        )

    def test_the_height_at_a_shift_is_that_of_the_first_exponent(self, translation: Translation, near: Pair) -> None:
        (peak,) = translation.find_at(*near, ALONE, np.array([[5.2, -3.4, 1.9]])).read()
        np.testing.assert_array_equal(peak.index, [5, EDGE - 3, 2])
        assert peak.value == pytest.approx(twin(*near, EXPONENTS[0])[5, -3, 2], rel=1e-4)


class TestOffset:
    @pytest.mark.parametrize("offset", [[2, -1, 1], [-3, 0, 2]])
    def test_peaks_are_at_the_shift_less_the_offset(self, translation, blocks, offset):
        """Nothing leaves the grid: all of the correlation moves."""
        points = place(3, [-8, -9, -7], [9, 8, 9])
        target, source = pair_of(blocks, points, [3, -2, 1])
        plain = [each.get() for each in translation.correlations(target, source, R)]
        moved = [each.get() for each in translation.correlations(target, source, R, np.array(offset))]
        for before, after in zip(plain, moved, strict=True):
            np.testing.assert_allclose(after, np.roll(before, -np.array(offset), (0, 1, 2)), atol=1e-5 * before.max())
            top = np.unravel_index(after.argmax(), after.shape)
            assert [int(k) for k in top] == [int(k) % EDGE for k in np.array([3, -2, 1]) - offset]


class TestBox:
    @pytest.mark.parametrize("center", [[20, 3, -4], [18, 5, -3], [22, 1, -5]])
    def test_a_shift_beyond_half_the_grid_is_named_as_it_is(self, translation, far, center):
        free = translation.find_within(*far, ALONE, [None], 1, 2.0)[0]
        np.testing.assert_allclose(free[0][0].shift, [FAR[0] - EDGE, *FAR[1:]], atol=0.5)
        box = Box(np.array(center, float), np.array([3.0, 2.5, 4.0]))
        boxed = translation.find_within(*far, ALONE, [box], 1, 2.0)[0]
        assert len(boxed) == 2
        for peaks in boxed:
            np.testing.assert_allclose(peaks[0].shift, FAR, atol=0.5)

    def test_all_shifts_lie_in_it(self, translation: Translation, far: Pair) -> None:
        """A peak's voxel; between voxels half a one more."""
        center, half = np.array([-11.0, 4.0, 13.0]), np.array([4.0, 2.2, 5.0])
        for peaks in translation.find_within(*far, ALONE, [Box(center, half)], 6, 1.0)[0]:
            assert len(peaks) > 1
            for peak in peaks:
                assert (np.abs(peak.shift - center) <= np.floor(half) + 0.5).all()

    def test_it_sees_the_highest_there_and_not_the_highest_of_all(self, translation: Translation, near: Pair) -> None:
        """Peaks of the twin within the box, though the true shift lies outside."""
        center, half = np.array([-4.0, 3.0, 0.0]), np.array([3.0, 4.0, 5.0])
        found = translation.find_within(*near, ALONE, [Box(center, half)], 3, 1.0)[0]
        for exponent, peaks in zip(EXPONENTS, found, strict=True):
            correlation = twin(*near, exponent, center)
            voxels = np.array(highest_maxima(correlation, EDGE**3, 0.0))
            signed = (voxels + EDGE // 2) % EDGE - EDGE // 2
            inside = voxels[(np.abs(signed) <= half).all(axis=1)]
            np.testing.assert_array_equal(peaks[0].index, inside[0])
            np.testing.assert_allclose(peaks[0].value, correlation[tuple(inside[0])], rtol=1e-3)
