"""How a map is laid out on a sheet, and its points as pixels."""

import numpy as np
import pytest

from sonarmap.tools.products.report.survey.image import color_range, lone, seen_from_above
from sonarmap.tools.products.report.survey.layout import extent_of, layout, twice

BED = np.random.default_rng(5).uniform([0, 0], [60, 40], (5000, 2))


class TestExtent:
    def test_single_points_far_away_do_not_count(self) -> None:
        lower, upper = extent_of([np.vstack([BED, [[900, 0]], [[0, -700]]])], [np.array([[5.0, 5.0]])])
        assert lower == pytest.approx([-1.8, -1.8], abs=0.2)
        assert upper == pytest.approx([61.8, 41.8], abs=0.2)

    def test_the_whole_track_counts(self) -> None:
        _, upper = extent_of([BED], [np.array([[5.0, 5.0], [100.0, 5.0]])])
        assert upper[0] > 100

    def test_a_cluster_far_away_counts(self) -> None:
        _, upper = extent_of([np.vstack([BED, BED / 10 + [200, 0]])], [BED[:1]])
        assert upper[0] > 205

    def test_a_single_point_has_an_extent(self) -> None:
        lower, upper = extent_of([np.array([[3.0, 4.0]])], [np.array([[3.0, 4.0]])])
        assert (lower < [3, 4]).all()
        assert (upper > [3, 4]).all()


class TestLayout:
    @pytest.mark.parametrize("size", [(60, 40), (40, 60), (1000, 20), (20, 1000), (1, 1e-3), (7, 2.9), (1e5, 3e4)])
    def test_every_place_is_in_some_window(self, size: tuple[float, float]) -> None:
        lower, upper = np.array([100.0, -50.0]), np.array([100.0, -50.0]) + size
        plan = layout(lower, upper)
        corners = plan.windows.reshape(-1, 2, 2)
        places = lower + np.random.default_rng(1).uniform(0, 1, (500, 2)) * size
        within = np.logical_and(places[:, None] >= corners[:, 0] - 1e-9, places[:, None] <= corners[:, 1] + 1e-9)
        assert np.any(np.all(within, axis=2), axis=1).all()
        width, height = plan.size
        assert width == pytest.approx(8.0)
        assert 3.0 - 1e-6 <= height <= 9.0 + 1e-6

    def test_a_long_map_is_larger_in_strips(self) -> None:
        one = layout(np.zeros(2), np.array([40.0, 20.0]))
        assert one.windows.shape[:2] == (1, 1)
        strips = layout(np.zeros(2), np.array([1000.0, 20.0]))
        assert strips.windows.shape[0] > 2
        assert strips.scale > 2 * 8 / 1000
        upright = layout(np.zeros(2), np.array([20.0, 1000.0]))
        assert upright.windows.shape[1] > 2

    def test_panels_do_not_overlap(self) -> None:
        plan = layout(np.zeros(2), np.array([1000.0, 20.0]))
        bottoms = [plan.place(row, 0)[1] for row in range(plan.windows.shape[0])]
        assert bottoms[-1] == 0
        assert (-np.diff(bottoms) > plan.panel[1] + 0.3).all()

    def test_two_maps_are_side_by_side_unless_they_are_long(self) -> None:
        assert twice(np.zeros(2), np.array([60.0, 40.0])).windows.shape[:2] == (1, 2)
        assert twice(np.zeros(2), np.array([600.0, 40.0])).windows.shape[:2] == (2, 1)
        windows = twice(np.zeros(2), np.array([60.0, 40.0])).windows
        assert (windows[0, 0] == windows[0, 1]).all()


class TestImage:
    def test_what_is_higher_hides_what_is_below(self) -> None:
        places = np.array([[5.2, 3.3], [5.2, 3.3], [1.5, 7.5]])
        seen = seen_from_above(places, np.array([-9.0, -4.0, -7.0]), np.zeros(2), (10, 20), 1.0, 0.1)
        assert seen[3, 5] == -4
        assert seen[7, 1] == -7
        assert np.count_nonzero(np.isfinite(seen)) == 8  # two pixels wide each

    def test_dots_are_about_as_large_as_voxels_and_round(self) -> None:
        seen = seen_from_above(np.array([[50.5, 50.5]]), np.array([1.0]), np.zeros(2), (101, 101), 1.0, 30.0)
        rows, columns = np.nonzero(np.isfinite(seen))
        assert np.ptp(rows) + 1 == np.ptp(columns) + 1 == pytest.approx(40, abs=1)
        distances = np.hypot(rows - 50, columns - 50)
        assert distances.max() < 1.15 * 20.5
        assert len(rows) == pytest.approx(np.pi * 20**2, rel=0.1)

    def test_points_outside_are_not_drawn(self) -> None:
        places = np.array([[-30.0, 2.0], [2.0, 40.0]])
        assert np.isnan(seen_from_above(places, np.ones(2), np.zeros(2), (10, 10), 1.0, 1.0)).all()

    def test_lone_points(self) -> None:
        bed = np.column_stack([BED, np.zeros(len(BED))])
        pole = np.array([[30.0, 20.0, z] for z in np.arange(5, 12, 0.5)])
        alone = np.array([[10.0, 10.0, 25.0], [50.0, 30.0, 25.0], [50.0, 30.3, 25.0]])
        specks = lone(np.vstack([bed, pole, alone]), 1.0)
        assert np.flatnonzero(specks).tolist() == list(range(len(bed) + len(pole), len(specks)))

    def test_a_sparse_map_has_no_lone_points(self) -> None:
        assert not lone(np.random.default_rng(2).uniform(0, 1000, (300, 3)), 1.0).any()

    def test_the_colors_of_nearly_nothing_span_half_a_voxel(self) -> None:
        assert color_range(np.array([3.0, 3.0]), 0.4) == pytest.approx((2.9, 3.1))
        assert color_range(np.arange(101.0), 0.4) == pytest.approx((1.0, 99.0))
