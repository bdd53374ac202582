"""Correlations of points at several poses equal NumPy's in double precision."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.correlator import Correlator, Pose, at_once
from sonarmap.kernels.pomf.spectrum import Pomf, whiten
from tests.samples.pomf_twin import correlation_of, highest_maxima, occupied
from tests.samples.refusals import refuses

BLUR = 0.7
EXPONENTS = (1.0, 0.5)
TOLERANCE = 1e-4  # of values and heights, relative


STILL = Pose(np.eye(3))


def make(device: Device, edge: int, exponents: tuple[float, ...] = EXPONENTS, most: int = 2) -> Correlator:
    return Correlator(device, edge, BLUR, exponents, most)


def surface(edge: int, count: int = 900) -> np.ndarray:
    """(count, 4): points of a relief inside the grid, with unequal weights."""
    rng = np.random.default_rng(edge)
    at = rng.uniform(-0.4, 0.4, (count, 2))
    height = 0.2 * np.sin(7 * at[:, 0]) * np.cos(5 * at[:, 1]) + 0.01 * rng.normal(size=count)
    return np.column_stack([edge * at, edge * height, rng.uniform(0.5, 2, count)]).astype(np.float32)


def volume_of(points: np.ndarray, edge: int, pose: Pose) -> np.ndarray:
    moved = points[:, :3] @ pose.R.T + (0 if pose.offset is None else pose.offset)
    return occupied(moved, edge, points[:, 3])


def poses(count: int) -> list[Pose]:
    """Rotated poses, since a scan with itself has equal peaks on both sides; some are moved, some limited."""
    offsets = [None, np.array([1.5, -2.0, 0.5])]
    limits = [None, np.array([3, 4.9, 6]), None]
    turns = Rotation.from_euler("ZYX", [[0.2 + 0.3 * k, -0.1 * k, 0.05] for k in range(count)]).as_matrix()
    return [Pose(R, offsets[k % 2], limits[k % 3]) for k, R in enumerate(turns)]


def spectra(device: Device, points: np.ndarray, edge: int, exponents: tuple[float, ...] = EXPONENTS):
    transformed = Pomf(device, (edge, edge, edge)).transform(voxelize(device, device.to_device(points), edge))
    return tuple(whiten(device, transformed, exponent) for exponent in exponents)


class TestPeaks:
    @pytest.mark.parametrize(
        ("edge", "number", "count"),
        [
            (16, 3, 1),
            (32, 5, 8),
            pytest.param(50, 3, 4, marks=pytest.mark.slow),
        ],
    )
    def test_equal_numpy(self, device: Device, edge, number, count) -> None:
        points, given = surface(edge), poses(number)
        found = make(device, edge).find(device.to_device(points), given, spectra(device, points, edge), count, 2.0)
        for n, pose in enumerate(given):
            for e, exponent in enumerate(EXPONENTS):
                peaks = found.of(n, e)
                want = correlation_of(volume_of(points, edge, STILL), volume_of(points, edge, pose), exponent, BLUR)
                assert [peak.index.tolist() for peak in peaks] == highest_maxima(want, count, 2.0, pose.limits)
                for peak in peaks:
                    assert peak.value == pytest.approx(want[tuple(peak.index)], rel=TOLERANCE)
                    assert (peak.mean, peak.std) == pytest.approx((want.mean(), want.std()), rel=TOLERANCE)
                    assert peak.psr == pytest.approx((peak.top - want.mean()) / want.std(), rel=TOLERANCE)
                    window = np.ix_(*((c + np.arange(-1, 2)) % edge for c in peak.index))
                    np.testing.assert_allclose(peak.neighborhood, want[window], atol=TOLERANCE * want.std())

    def test_do_not_depend_on_the_batch_size(self, device: Device) -> None:
        """Nor on earlier calls, which leave the volumes empty."""
        assert [at_once(edge) for edge in (16, 64, 512)] == [8, 2, 1]
        points, given = device.to_device(surface(32)), poses(5)
        targets = spectra(device, surface(32), 32)
        few, many = make(device, 32, most=1), make(device, 32, most=4)
        psr = [correlator.find(points, given, targets, 3, 2.0).peaks.psr for correlator in (few, many, few)]
        np.testing.assert_array_equal(psr[0], psr[2])
        np.testing.assert_allclose(psr[0], psr[1], rtol=1e-6)

    @pytest.mark.parametrize("edge", [32, pytest.param(18, marks=pytest.mark.slow)])
    def test_more_equal_maxima_than_the_device_lists(self, device: Device, edge: int) -> None:
        """A line along z correlates equally at all shifts along z; 18 cubed is no multiple of an alignment."""
        z = np.arange(-edge // 2, edge // 2)
        line = np.column_stack([0 * z, 0 * z, z, 0 * z + 1]).astype(np.float32)
        found = make(device, edge).find(device.to_device(line), [STILL], spectra(device, line, edge), 2, 2.0)
        for first, second in (found.of(0, e) for e in range(len(EXPONENTS))):
            assert first.index[:2].tolist() == second.index[:2].tolist() == [0, 0]
            assert abs(int(first.index[2] - second.index[2])) > 2

    def test_fewer_maxima_no_poses_and_no_points(self, device: Device) -> None:
        points, targets = surface(16), spectra(device, surface(16), 16)
        correlator, pose = make(device, 16), Pose(np.eye(3), limits=np.array([1, 1, 1]))
        found = correlator.find(device.to_device(points), [pose], targets, 20, 1.0)
        assert found.of(0).index.tolist() == [[0, 0, 0]]
        assert not len(correlator.find(device.to_device(points), [], targets, 1, 1.0).peaks)
        outside = device.to_device(points + np.float32(1000))
        found = correlator.find(outside, [STILL], targets, 1, 1.0)
        assert found.exponent.tolist() == [0, 1]
        assert found.peaks.psr.tolist() == [0.0, 0.0]

    def test_nan_is_refused(self, device: Device) -> None:
        points = surface(16)
        targets = [target.copy() for target in spectra(device, points, 16)]
        targets[1][3, 2] = np.nan
        refuses("not finite", make(device, 16).find, device.to_device(points), [STILL], targets, 1, 1.0)
        near = make(device, 16, (0.5,)).near(device.to_device(points), [STILL], targets[1:], np.zeros((1, 3), int))
        refuses("not finite", near.read)


class TestAt:
    @pytest.mark.parametrize("edge", [16, pytest.param(18, marks=pytest.mark.slow)])
    def test_is_linear_between_voxels_and_cyclic(self, device: Device, edge) -> None:
        points, pose = surface(edge), poses(2)[1]
        places = np.random.default_rng(edge).uniform(-2 * edge, 2 * edge, (200, 3))
        places[:3] = [[0, 0, 0], [edge - 0.5, -0.25, edge + 0.75], [-edge, 3, 1.5]]
        given = device.to_device(points), pose, spectra(device, points, edge)
        found = make(device, edge).at(*given, places).read()
        for exponent, values in zip(EXPONENTS, found, strict=True):
            want = correlation_of(volume_of(points, edge, STILL), volume_of(points, edge, pose), exponent, BLUR)
            between = map_coordinates(want, places.T, order=1, mode="grid-wrap")
            np.testing.assert_allclose(values, between, atol=3 * TOLERANCE * want.std())


class TestNear:
    @pytest.mark.parametrize("edge", [16, pytest.param(18, marks=pytest.mark.slow)])
    def test_equals_the_whole_correlation(self, device: Device, edge) -> None:
        points, given = surface(edge), poses(4)
        shifts = np.array([[0, 0, 0], [2, -3, 1], [5, 1, -edge // 2], [-7, edge + 3, 4]])
        near = make(device, edge, (1.0,)).near(device.to_device(points), given, spectra(device, points, edge), shifts)
        for pose, shift, peak in zip(given, shifts, near.read(), strict=True):
            want = correlation_of(volume_of(points, edge, STILL), volume_of(points, edge, pose), 1.0, BLUR)
            around = want[np.ix_(*((shift[:, None] + np.arange(-1, 2)) % edge))]
            assert peak.value == pytest.approx(around.max(), rel=TOLERANCE)
            assert want[tuple(peak.index)] == around.max()
            window = np.ix_(*((c + np.arange(-1, 2)) % edge for c in peak.index))
            np.testing.assert_allclose(peak.neighborhood, want[window], atol=TOLERANCE * want.std())
            assert (peak.mean, peak.std) == pytest.approx((want.mean(), want.std()), rel=TOLERANCE)
