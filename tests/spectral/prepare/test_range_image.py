"""Range images of a scan, and points that agree with them, contradict them or are hidden."""

import numpy as np
import pytest

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import Array, Device
from sonarmap.spectral.prepare.range_image import View, scan_view, visibility

VIEWPOINT = np.array([3.0, -2.0, 1.0])


def still(device: Device) -> Array:
    """The identity pose."""
    return upload_poses(device, np.eye(3)[None], np.zeros((1, 3)))


def shell(radius: float, seed: int = 1, count: int = 60_000, cone: float = -1.0) -> np.ndarray:
    """Points (n, 3) at a range from the viewpoint, in directions whose x component is above `cone` [voxels]."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return VIEWPOINT + radius * directions[directions[:, 0] > cone]


def view_of(device: Device, points: np.ndarray, viewpoints: np.ndarray = VIEWPOINT) -> View:
    return scan_view(device, points.astype(np.float32), points, viewpoints)


def cells_of(view: View) -> np.ndarray:
    """The only range image (edge, edge, 2) of a view."""
    assert view.ranges is not None
    return view.ranges.get()[0]


def test_cells_hold_the_ranges_of_their_points(device: Device) -> None:
    view = cells_of(view_of(device, shell(20.0)))
    seen = np.isfinite(view[..., 0])
    assert seen.mean() > 0.9
    np.testing.assert_allclose(view[seen], 20.0, rtol=1e-5)
    assert (view[~seen] == [np.inf, -np.inf]).all()


def test_a_stray_echo_among_many_changes_no_cell(device: Device) -> None:
    """A hundred points in one direction, at ranges of 20 to 21, and one at 5 and one at 60."""
    along = np.array([0.6, 0.64, 0.48])
    ranges = np.concatenate([np.linspace(20, 21, 100), [5.0, 60.0]])
    view = cells_of(view_of(device, VIEWPOINT + ranges[:, None] * along))
    near, far = view[np.isfinite(view[..., 0])].T
    assert (near >= 19.99).all()
    assert (far <= 21.01).all()
    assert near.min() < 20.3
    assert far.max() > 20.7


# Most points are alone in their cells, and would agree with themselves.
SPARSE = [(1500, 1500, False), (6000, 6000, False), (1500, 0, True), (6000, 0, True)]


@pytest.mark.parametrize(
    ("count", "inner", "single"), [*((60_000, *case) for case in ((0, True), (6000, True), (30_000, False))), *SPARSE]
)
def test_two_layers_give_no_view(device: Device, count: int, inner: int, single: bool) -> None:
    points = np.vstack([shell(20.0, 1, count), shell(12.0, 2, count)[:inner]])
    assert bool(len(view_of(device, points).places)) is single


class TestVisibility:
    """A wall all around the target's sensor at 20 voxels; the source shows a part of another."""

    @staticmethod
    def shares(device: Device, radius: float, reach: float = 1.0, slope: float = 0.0) -> np.ndarray:
        """Shares that agree, contradict, and are seen, of the source's points alone."""
        target = view_of(device, shell(20.0, 1))
        source = view_of(device, np.vstack([shell(radius, 3, cone=0.5), shell(9.0, 4, cone=0.5)]))
        assert source.ranges is None
        (shares,) = visibility(device, target, source, still(device), [(reach, slope)]).read()
        return np.array([shares.agree[0], shares.contradict[0], shares.seen[0]])

    def test_points_on_the_surface_agree_those_before_it_contradict_and_those_behind_say_nothing(self, device) -> None:
        agree, contradict, seen = self.shares(device, 20.0)
        assert agree == pytest.approx(0.5, abs=0.06)
        assert contradict == pytest.approx(0.5, abs=0.06)
        assert seen > 0.9
        assert self.shares(device, 26.0)[:2].tolist() == [0, pytest.approx(0.5, abs=0.06)]
        # reach and slope widen what agrees
        assert self.shares(device, 18.5, 1.0)[0] == 0
        assert self.shares(device, 18.5, 2.0)[0] > 0.4
        assert self.shares(device, 18.5, 1.0, 0.05)[0] > 0.4


def test_without_any_view_shares_are_nan(device: Device) -> None:
    blind = view_of(device, np.vstack([shell(20.0, 1), shell(12.0, 2)]))
    (shares,) = visibility(device, blind, blind, still(device), [(1.0, 0.0)]).read()
    assert np.isnan([shares.agree, shares.contradict, shares.seen]).all()


class TestManyViewpoints:
    """A wall at x = 20, seen in halves from two places; an object before the far half is visible from one only."""

    PLACES = np.array([[0.0, -12.0, 1.0], [0.0, 12.0, -1.0]])

    def wall(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Points, and the viewpoint of each."""
        rng = np.random.default_rng(seed)
        points = np.column_stack([np.full(16_000, 20.0), rng.uniform(-20, 20, 16_000), rng.uniform(-8, 8, 16_000)])
        return points, self.PLACES[(points[:, 1] > 0).astype(int)]

    def test_one_place_for_all_points_is_a_single_view(self, device: Device) -> None:
        points = shell(20.0)
        given = view_of(device, points, np.tile(VIEWPOINT, (len(points), 1)))
        np.testing.assert_array_equal(cells_of(given), cells_of(view_of(device, points)))
        assert given.repeats == pytest.approx(1.0)

    def test_every_place_has_an_image_of_what_was_seen_from_there(self, device: Device) -> None:
        points, places = self.wall(1)
        view = view_of(device, points, places)
        assert view.ranges is not None
        for viewpoint, cells in zip(view.places, view.ranges.get(), strict=True):
            (place,) = [place for place in self.PLACES if np.allclose(place, viewpoint)]
            near = cells[..., 0]
            half = points[np.sign(points[:, 1]) == np.sign(place[1])]
            ranges = np.linalg.norm(half - place, axis=1)
            assert ranges.min() - 0.01 <= near[np.isfinite(near)].min()
            assert near[np.isfinite(near)].max() <= ranges.max()

    def test_only_some_of_very_many_places_are_used(self, device: Device) -> None:
        """A line flown over a bed: 300 pings from 300 places."""
        along = np.repeat(np.arange(300.0), 40)
        across = np.tile(np.linspace(-15, 15, 40), 300)
        points = np.column_stack([along, across, np.full(12_000, -12.0)])
        places = np.column_stack([along, 0 * along, 0 * along])
        view = view_of(device, points, places)
        assert len(view.places) == 12
        stations = view.places[:, 0]
        assert stations.min() < 10
        assert stations.max() > 290


def test_shares_are_the_mean_of_both_views(device: Device) -> None:
    """The target's sensor saw as far as 30 voxels, the source's 20 in the same direction."""
    far, near = view_of(device, shell(30.0, 1)), view_of(device, shell(20.0, 2))
    (shares,) = visibility(device, far, near, still(device), [(1.0, 0.0)]).read()
    assert shares.contradict[0] == pytest.approx(0.5, abs=0.05)
    assert shares.agree[0] == 0
