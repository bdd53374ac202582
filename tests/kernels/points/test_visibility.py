"""Visibility of points in range images: laws of the octahedral map, and counts compared with NumPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.points.visibility import Viewing, agreement, octahedral_cells, upload_points, upload_viewpoints


def unfold(cells, edge):
    """The direction of each cell's center: the inverse of the map, by its definition."""
    u, v = ((np.array(np.divmod(cells, edge)) + 0.5) / edge) * 2 - 1
    z = 1 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, (1 - np.abs(v)) * np.sign(u), u)
    y = np.where(z < 0, (1 - np.abs(u)) * np.sign(v), v)
    directions = np.stack([x, y, z], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


class TestCells:
    @pytest.mark.parametrize("edge", [2, 7, 32])
    def test_direction_of_each_center_maps_to_its_cell(self, edge):
        cells = np.arange(edge**2)
        np.testing.assert_array_equal(octahedral_cells(unfold(cells, edge), edge), cells)

    def test_asymmetric_directions(self):
        # |x| + |y| + |z| = 1: (u, v) = (0.5, -0.2) above; below (1 - 0.2, -(1 - 0.5)) = (0.8, -0.5)
        directions = np.array([[0.5, -0.2, 0.3], [0.5, -0.2, -0.3], [50, -20, 30], [-0.1, 0.6, -0.3]])
        # the last: (-(1 - 0.6), 1 - 0.1) = (-0.4, 0.9)
        want = [15 * 20 + 8, 18 * 20 + 5, 15 * 20 + 8, 6 * 20 + 19]
        np.testing.assert_array_equal(octahedral_cells(directions, 20), want)

    def test_border_and_zero_directions_have_a_cell(self):
        directions = np.array([[0, 0, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, -0.0]])
        cells = octahedral_cells(directions, 16)
        assert cells.min() >= 0
        assert cells.max() < 256
        assert cells[0] == cells[1]
        assert octahedral_cells(np.zeros((0, 3)), 16).shape == (0,)


def twin(view, points, R, t, reach, slope):
    """Counts in float64, and the number of points per pose that float32 cannot assign, near a border."""
    edge = len(view)
    counts, doubtful = np.zeros((len(R), 3), np.int64), np.zeros(len(R), np.int64)
    for n in range(len(R)):
        moved = points @ R[n].T + t[n]
        distance = np.linalg.norm(moved, axis=1)
        near, far = view.reshape(-1, 2)[octahedral_cells(moved, edge)].astype(np.float64).T
        tolerance = reach + slope * distance
        seen = far >= 0
        contradicts = seen & (distance < near - tolerance)
        agrees = seen & ~contradicts & (distance <= far + tolerance)
        counts[n] = agrees.sum(), contradicts.sum(), seen.sum()
        rng = np.random.default_rng(n)
        shaken = [octahedral_cells(moved + rng.normal(scale=3e-6, size=moved.shape) * distance[:, None], edge)]
        shaken.append(octahedral_cells(2 * moved - (moved + 1e-5 * rng.normal(size=moved.shape)), edge))
        border = np.any([cells != octahedral_cells(moved, edge) for cells in shaken], axis=0)
        with np.errstate(invalid="ignore"):
            close = np.minimum(np.abs(distance - near + tolerance), np.abs(distance - far - tolerance)) < 1e-4
        doubtful[n] = (border | close).sum()
    return counts, doubtful


def random_view(edge, seed):
    """Ranges from 5 to 30, with half of the cells unseen."""
    rng = np.random.default_rng(seed)
    near = rng.uniform(5, 25, (edge, edge))
    view = np.stack([near, near + rng.uniform(0, 5, near.shape)], axis=-1)
    view[rng.random(near.shape) < 0.5] = np.inf, -np.inf
    return view.astype(np.float32)


def random_poses(count, seed):
    rng = np.random.default_rng(seed)
    return Rotation.random(count, rng=rng).as_matrix(), rng.uniform(-8, 8, (count, 3))


def alone(device, view, points, R, t, reach, slope):
    """(n, 3) counts of points in one image, with one tolerance."""
    viewing = Viewing(view.reshape(1, *view.shape), upload_viewpoints(device, np.zeros((1, 3))), points)
    (counts,) = agreement(device, [viewing], upload_poses(device, R, t), [(reach, slope)]).read()
    return counts[0, :, 0]


class TestAgreement:
    @pytest.mark.quick_cases(2)
    @pytest.mark.parametrize(("edge", "points", "poses"), [(64, 1500, 20), (16, 7, 5), (32, 256, 2)])
    @pytest.mark.parametrize(("reach", "slope"), [(1.5, 0.03), (0.0, 0.0)])
    def test_equals_the_twin(self, device, edge, points, poses, reach, slope):
        view = random_view(edge, seed=3)
        places = np.random.default_rng(4).uniform(-15, 15, (points, 3)).astype(np.float32)
        R, t = random_poses(poses, 5)
        got = alone(device, device.to_device(view), upload_points(device, places), R, t, reach, slope)
        want, doubtful = twin(view, places.astype(np.float64), R, t, reach, slope)
        assert got.dtype == np.int64
        assert (np.abs(got - want) <= doubtful[:, None]).all()
        # few enough points are doubtful for the comparison to mean something
        assert doubtful.sum() <= 1 + 0.01 * points * poses

    @pytest.mark.parametrize("count", [0, 9, 256])
    def test_unseen_cells_and_padding_are_not_counted(self, device, count):
        """In the second view every cell is seen, and the padding's zeros would agree with it."""
        points = upload_points(device, np.zeros((count, 3)))
        assert points[1] == count
        pose = np.eye(3)[None], np.zeros((1, 3))
        for view, want in (((np.inf, -np.inf), [0, 0, 0]), ((0, 0), [count, 0, count])):
            there = device.to_device(np.full((16, 16, 2), view, np.float32))
            np.testing.assert_array_equal(alone(device, there, points, *pose, 1, 0), [want])
            assert alone(device, there, points, pose[0][:0], pose[1][:0], 1, 0).shape == (0, 3)

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("images", [(3, 2), (0, 2)])
    def test_batch_equals_single_images(self, device, images):
        """Several images of two scans, with two tolerances; points at borders may differ, as the inverse is rounded."""
        tolerances = [(1.5, 0.03), (0.2, 0.0)]
        viewings, places, rng = [], [], np.random.default_rng(21)
        for number, count in enumerate(images):
            points = upload_points(device, rng.uniform(-15, 15, (100 + 70 * number, 3)))
            views = np.stack([random_view(32, 30 + 5 * number + k) for k in range(count)]) if count else None
            places.append(rng.uniform(-4, 4, (count, 3)))
            there = upload_viewpoints(device, places[-1])
            viewings.append(Viewing(*(None, None) if views is None else (device.to_device(views), there), points))
        R, t = random_poses(7, 40)
        back = R.transpose(0, 2, 1)
        got = agreement(device, viewings, upload_poses(device, R, t), tolerances).read()
        for viewing, seen_from, counts, turns, shifts in zip(
            viewings, places, got, (R, back), (t, -np.einsum("nij,nj->ni", back, t)), strict=True
        ):
            assert counts.shape == (len(seen_from), 7, 2, 3)
            for k, of_image in enumerate(counts):
                for number, tolerance in enumerate(tolerances):
                    want = alone(device, viewing.views[k], viewing.points, turns, shifts - seen_from[k], *tolerance)
                    assert np.abs(of_image[:, number] - want).max() <= 1
                    assert (of_image[:, number] != want).mean() < 0.1
