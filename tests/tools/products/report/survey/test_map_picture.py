"""The pictures of maps, loops and sheets: words, colors, tracks, and that nothing overlaps."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.products.report.loops_picture import loops_figure
from sonarmap.tools.products.report.map_picture import draw_map, map_figure
from sonarmap.tools.products.report.survey.image import color_range, lone, seen_from_above
from sonarmap.tools.products.report.survey.layout import extent_of, layout, twice
from sonarmap.tools.products.report.survey.view import PartView, verdict_of
from tests.tools.products.report.survey.known_view import (
    SEA,
    bed,
    cloud,
    levels_of,
    overlapping_texts,
    pair,
    track,
    view_of,
)

FAR = 512_345, 6_700_000
LONG = "a folder with a long name " * 4
KINDS: dict[str, PartView] = {
    "small": view_of(bed(9, 6), track(9, 6, 12)),
    "two scans": view_of(bed(9, 6), track(3, 2, 2)),
    "one scan": view_of(bed(9, 6), track(3, 2, 1)),
    "does not move": view_of(bed(20, 10), np.full((30, 3), -5.0) + 1e-3 * track(1, 1, 30)),
    "long": view_of(bed(1000, 20), track(1000, 15, 150), frame=SEA),
    "tall": view_of(bed(20, 1000), track(15, 1000, 150), frame=SEA),
    "flat": view_of(bed(9, 6) * [1, 1, 0], track(9, 6, 4)),
    "a wall": view_of(bed(40, 0.4), track(40, 0, 20, 0, 8)),
    "a single point": view_of(np.array([[3.0, 4.0, -7.0]]), track(3, 2, 3)),
    "two surveys": view_of(
        bed(90, 60),
        np.concatenate([track(90, 60, 20), track(90, 60, 20, 0, 2)]),
        surveys=(0,) * 20 + (1,) * 20,
        survey_names={0: "survey 0 (monday)", 1: "survey 1 (a folder with a longer name)"},
    ),
    "a long title": view_of(bed(9, 6), track(9, 6, 12), title=LONG, names=(LONG,) * 12),
    "far from the origin": view_of(bed(90, 60, *FAR), track(90, 60, 30, *FAR)),
    "a dense track": view_of(bed(90, 60), np.tile(track(90, 60, 100), (5, 1)) + np.array([2.0, -2.5, 0.4])),
}


def legend_of(figure: Figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def texts_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize("kind", KINDS)
def test_no_text_lies_upon_another_or_leaves_the_sheet(kind: str) -> None:
    assert overlapping_texts(map_figure(KINDS[kind])) == []


def test_the_words_say_what_it_is() -> None:
    figure = map_figure(KINDS["small"])
    assert texts_of(figure) == ["harbor, 2024-05-17", "12 scans, 216 points, voxel 0.5 m", KINDS["small"].frame.note]
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert legend_of(figure)[:3] == ["track of the sensor, 12 scans", "start: scan_000", "end: scan_011"]
    assert "N" not in [text.get_text() for each in figure.axes for text in each.texts]
    figure = map_figure(view_of(bed(9, 6), track(9, 6, 3), frame=SEA))  # where North is known
    assert "N" in [text.get_text() for axes in figure.axes for text in axes.texts]
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("East [m]", "North [m]")


def test_the_colors_are_of_depths_and_the_shallow_is_above() -> None:
    """z from -30 to -10, the zero of depths at 2: depths of 12 to 32, of which 1 % on either side saturate."""
    figure = map_figure(view_of(bed(100, 60), track(90, 60, 3), frame=SEA))
    (bar,) = [axes for axes in figure.axes if axes.get_ylabel() == "depth [m]"]
    lower, upper = bar.get_ylim()
    assert (lower, upper) == pytest.approx((31.8, 12.3), abs=0.2)  # downward
    image: Any = figure.images[0]
    assert image.get_clim() == pytest.approx((12.3, 31.8), abs=0.2)
    levels = levels_of(image).mean(axis=0)
    assert levels[20:-20].compressed()[[0, -1]] == pytest.approx([32, 12], abs=1)
    lightness = [image.cmap(image.norm(level))[:3] @ np.array([0.3, 0.6, 0.1]) for level in (30, 22, 14)]
    assert lightness[0] < lightness[1] - 0.1 < lightness[2] - 0.2  # the deeper, the darker, in gray prints too
    figure = map_figure(KINDS["flat"])  # heights grow upward, and a flat bed has a range
    (bar,) = [axes for axes in figure.axes if axes.get_ylabel().startswith("height")]
    assert bar.get_ylim() == pytest.approx((-0.125, 0.125))
    assert np.ptp(levels_of(figure.images[0]).compressed()) == 0


def test_the_image_lies_where_its_points_do() -> None:
    """A lone pillar at (20, 5) of a bed of 30 m by 15 m."""
    pillar = np.array([20.0, 5.0, -4.0]) + 0.2 * np.random.default_rng(1).normal(size=(40, 3)) * [1, 1, 0]
    figure = map_figure(view_of(np.vstack([bed(30, 15) * [1, 1, 0] - [0, 0, 30], pillar]), track(30, 15, 2)))
    image: Any = figure.images[0]
    axes = figure.axes[0]
    rows, columns = np.nonzero(levels_of(image) > -10)
    dots = np.column_stack([columns + image.ox + 0.5, rows + image.oy + 0.5])
    places = axes.transData.inverted().transform(dots)
    assert places.mean(axis=0) == pytest.approx([20, 5], abs=0.1)
    assert np.abs(places - [20, 5]).max() < 1.2
    assert axes.transData.transform([[0, 0], [1, 0], [0, 1]])[1:] - axes.transData.transform([0, 0]) == pytest.approx(
        np.diag([axes.bbox.width / np.diff(axes.get_xlim())[0]] * 2)
    )


@pytest.mark.slow
def test_what_is_left_out_is_said_and_not_drawn() -> None:
    """Doubtful points are not in a part's map at all; a point alone in the water is in it, and far from the others."""
    points = np.vstack([bed(30, 15), [[10.0, 5.0, 40.0]], [[400.0, 300.0, -20.0]]])
    figure = map_figure(view_of(points, track(30, 15, 4), doubted=1234))
    assert levels_of(figure.images[0]).max() < 0
    assert figure.axes[0].get_xlim()[1] < 40
    note = " ".join(texts_of(figure)[2:][::-1])  # from below
    assert "1,234 more points, seen by too few scans" in note
    assert "Not drawn: 2 points of the map that stand alone." in note


def test_a_long_track_is_cut_into_strips_that_show_all_of_it() -> None:
    figure = map_figure(KINDS["long"])
    panels = [axes for axes in figure.axes if axes.get_ylabel() == "North [m]"]
    assert len(panels) > 2
    edges = [axes.get_xlim() for axes in panels]
    assert edges[0][0] < 0 < 1000 < edges[-1][1]
    assert all(after[0] <= before[1] for before, after in pairwise(edges))
    scales = np.ravel([np.divide(axes.bbox.size, axes.viewLim.size) for axes in panels]).tolist()
    assert scales == pytest.approx([scales[0]] * len(scales))


def test_arrows_point_along_the_track() -> None:
    """From the upper right to the lower left: both coordinates fall."""
    axes = map_figure(view_of(bed(90, 60), track(90, 60, 20)[::-1])).axes[0]
    markers: list[Any] = [line.get_marker() for line in axes.lines if hasattr(line.get_marker(), "vertices")]
    assert len(markers) > 4
    tips = np.array([marker.vertices[1] for marker in markers])
    assert (tips < 0).all()
    np.testing.assert_allclose(tips[:, 1] / tips[:, 0], 60 / 90, rtol=0.02)


def test_each_survey_has_a_color_of_its_own_and_its_name() -> None:
    figure = map_figure(KINDS["two surveys"])
    (legend,) = figure.legends
    assert legend_of(figure)[:2] == ["survey 0 (monday), 20 scans", "survey 1 (a folder with a longer name), 20 scans"]
    tracks = [line for line in figure.axes[0].lines if len(np.array(line.get_xdata())) == 20]
    colors = [line.get_color() for line in tracks]
    assert len(set(colors)) == 2
    assert [handle.get_color() for handle in legend.legend_handles[:2]] == colors  # type: ignore[union-attr]


def test_some_scans_have_their_numbers_beside_them() -> None:
    view = view_of(bed(90, 60), track(90, 60, 40), scans=tuple(range(100, 140)))
    axes = map_figure(view).axes[0]
    labels = {text.get_text(): text.xy for text in axes.texts if isinstance(text, Annotation)}
    assert len(labels) >= 7
    for name, place in labels.items():
        assert place == pytest.approx(track(90, 60, 40)[int(name) - 100, :2])


def test_the_same_view_gives_the_same_file_with_names_in_any_script(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        view = view_of(bed(9, 6), track(9, 6, 3), title="深 \\$x^", names=("$x^ \n\udcff深",) * 3)
        draw_map(tmp_path / name, view)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.png").stat().st_size > 10_000


def view(count: int = 40, loops: int = 12, width: float = 90, height: float = 60) -> PartView:
    """Of every six loops four are kept, one was refused, and one rejected by the others."""
    apart = min(5, count - 1)
    starts = [k % (count - apart) for k in range(loops)]
    tried = [pair(i, i + apart, "loop", k % 6 < 4, k % 6 != 4) for k, i in enumerate(starts)]
    moved = bed(width, height, 0, 3)
    return view_of(bed(width, height), track(width, height, count), tuple(tried), chained=cloud(moved), frame=SEA)


def lines_of(figure: Figure) -> list[Any]:
    drawn = (each for axes in figure.axes for each in axes.collections)
    return [each for each in drawn if isinstance(each, LineCollection) and each.get_segments()]


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    "shown",
    [view(), view(loops=0), view(loops=500), view(3, 1), view(30, 20, 900, 20), view(30, 20, 20, 900)],
    ids=["some", "none", "500", "one loop", "long", "tall"],
)
def test_no_text_of_loops_lies_upon_another_or_leaves_the_sheet(shown: PartView) -> None:
    assert overlapping_texts(loops_figure(shown)) == []


def test_what_the_loops_moved_is_said() -> None:
    shown = view()
    T = shown.trajectory.T_world_sensor
    apart = np.zeros((len(T), 3))
    apart[-1] = 0.3, 0.0, -0.4
    chained = replace(shown.trajectory, T_world_sensor=RigidTransform.from_translation(apart) * T)
    figure = loops_figure(replace(shown, chained_poses=chained))
    assert "after: 8 loops kept, poses moved by up to 0.5 m" in [axes.get_title() for axes in figure.axes]


def test_both_panels_have_the_same_extent_and_colors() -> None:
    figure = loops_figure(view())
    before, after = (axes for axes in figure.axes if axes.get_xlabel() == "East [m]")
    assert (before.get_xlim(), before.get_ylim()) == (after.get_xlim(), after.get_ylim())
    assert before.get_ylim()[1] > 63  # where the map of the chain ends
    images: list[Any] = list(figure.images)
    assert images[0].get_clim() == images[1].get_clim()
    assert images[0].cmap == images[1].cmap
    titles = (before.get_title(), after.get_title(), figure.texts[0].get_text())
    assert titles[:2] == ("before: consecutive registrations, chained", "after: 8 loops kept")
    assert titles[2] == "harbor, 2024-05-17: before and after the loops"
    tops = []  # the map of the chain, which lies 3 m farther up, is before
    for image, axes in zip(images, (before, after), strict=True):
        shown = ~np.ma.getmaskarray(levels_of(image))
        top = np.flatnonzero(shown.any(axis=1)).max() + image.oy
        tops.append(axes.transData.inverted().transform([0, top])[1])
    assert tops[0] - tops[1] == pytest.approx(3, abs=0.3)


@pytest.mark.slow
def test_loops_are_drawn_by_verdict_and_counted() -> None:
    shown = view()
    figure = loops_figure(shown)
    assert legend_of(figure)[-3:] == [
        "8 loops kept",
        "2 loops rejected: the other pairs contradict",
        "2 loops refused by the registration itself",
    ]
    lines = lines_of(figure)
    assert [len(each.get_segments()) for each in lines] == [8, 2, 2]
    ends = np.array([segment[[0, -1]] for segment in lines[1].get_segments()])
    places = shown.trajectory.T_world_sensor.translation[:, :2]
    assert ends == pytest.approx(np.array([places[[k, k + 5]] for k in (5, 11)]))
    assert len({tuple(each.get_color()[0]) for each in lines}) == 3
    assert len({str(each.get_linestyle()) for each in lines}) == 3
    few, many = (lines_of(loops_figure(view(loops=count)))[0].get_linewidth()[0] for count in (6, 500))
    assert many < 0.5 < few


def test_verdicts() -> None:
    for kept, accepted, verdict in ((True, False, "kept"), (False, True, "rejected"), (False, False, "refused")):
        assert verdict_of(pair(0, 5, "loop", kept=kept, accepted=accepted)) == verdict


BED = np.random.default_rng(5).uniform([0, 0], [60, 40], (5000, 2))


@pytest.mark.parametrize(
    ("points", "whole", "low", "high"),
    [
        (np.vstack([BED, [[900, 0]], [[0, -700]]]), [[5, 5]], (-1.8, -1.8), (61.8, 41.8)),  # single points far away
        (BED, [[5, 5], [100, 5]], (-3, -3), (103, 43)),  # the whole track counts
        (np.vstack([BED, BED / 10 + [200, 0]]), [[5, 5]], (-6, -6), (212, 46)),  # a cluster far away counts
        (np.array([[3.0, 4.0]]), [[3, 4]], (2.985, 3.985), (3.015, 4.015)),  # a single point has an extent
    ],
)
def test_the_extent_is_of_what_is_worth_showing(
    points: np.ndarray, whole: list[list[float]], low: tuple[float, float], high: tuple[float, float]
) -> None:
    lower, upper = extent_of([points], [np.array(whole, float)])
    assert lower == pytest.approx(low, abs=0.25)
    assert upper == pytest.approx(high, abs=0.25)
    assert (lower < np.min(whole, axis=0)).all()
    assert (upper > np.max(whole, axis=0)).all()


@pytest.mark.parametrize(
    ("size", "shape"),
    [
        *(((60, 40), (1, 1)), ((40, 60), (1, 1)), ((1000, 20), (6, 1)), ((20, 1000), (1, 5)), ((1, 1e-3), (6, 1))),
        *(((7, 2.9), (1, 1)), ((1e5, 3e4), (2, 1))),
    ],
)
def test_every_place_is_in_some_panel_and_long_maps_are_larger_in_strips(
    size: tuple[float, float], shape: tuple[int, int]
) -> None:
    lower, upper = np.array([100.0, -50.0]), np.array([100.0, -50.0]) + size
    plan = layout(lower, upper)
    assert plan.windows.shape[:2] == shape
    corners = plan.windows.reshape(-1, 2, 2)
    places = lower + np.random.default_rng(1).uniform(0, 1, (500, 2)) * size
    within = np.logical_and(places[:, None] >= corners[:, 0] - 1e-9, places[:, None] <= corners[:, 1] + 1e-9)
    assert np.any(np.all(within, axis=2), axis=1).all()
    width, height = plan.size
    assert width == pytest.approx(8.0)
    assert 3.0 - 1e-6 <= height <= 9.0 + 1e-6
    bottoms = [plan.place(row, 0)[1] for row in range(shape[0])]
    assert bottoms[-1] == 0
    assert (-np.diff(bottoms) > plan.panel[1] + 0.3).all()  # panels do not overlap


def test_two_maps_are_side_by_side_unless_they_are_long() -> None:
    beside, below = (twice(np.zeros(2), np.array([width, 40.0])).windows for width in (60.0, 600.0))
    assert (beside.shape[:2], below.shape[:2]) == ((1, 2), (2, 1))
    assert (beside[0, 0] == beside[0, 1]).all()


def test_what_is_higher_hides_what_is_below_and_what_is_outside_is_not_drawn() -> None:
    places = np.array([[5.2, 3.3], [5.2, 3.3], [1.5, 7.5], [-30.0, 2.0], [2.0, 40.0]])
    seen = seen_from_above(places, np.array([-9.0, -4.0, -7.0, 1, 1]), np.zeros(2), (10, 20), 1.0, 0.1)
    assert (seen[3, 5], seen[7, 1]) == (-4, -7)
    assert np.count_nonzero(np.isfinite(seen)) == 8  # two pixels wide each


def test_dots_are_about_as_large_as_voxels_and_round() -> None:
    seen = seen_from_above(np.array([[50.5, 50.5]]), np.array([1.0]), np.zeros(2), (101, 101), 1.0, 30.0)
    rows, columns = np.nonzero(np.isfinite(seen))
    assert np.ptp(rows) + 1 == np.ptp(columns) + 1 == pytest.approx(40, abs=1)
    assert np.hypot(rows - 50, columns - 50).max() < 1.15 * 20.5
    assert len(rows) == pytest.approx(np.pi * 20**2, rel=0.1)


def test_lone_points() -> None:
    bed = np.column_stack([BED, np.zeros(len(BED))])
    pole = np.array([[30.0, 20.0, z] for z in np.arange(5, 12, 0.5)])
    alone = np.array([[10.0, 10.0, 25.0], [50.0, 30.0, 25.0], [50.0, 30.3, 25.0]])
    specks = lone(np.vstack([bed, pole, alone]), 1.0)
    assert np.flatnonzero(specks).tolist() == list(range(len(bed) + len(pole), len(specks)))
    assert not lone(np.random.default_rng(2).uniform(0, 1000, (300, 3)), 1.0).any()  # none in a sparse map


def test_the_colors_of_nearly_nothing_span_half_a_voxel() -> None:
    assert color_range(np.array([3.0, 3.0]), 0.4) == pytest.approx((2.9, 3.1))
    assert color_range(np.arange(101.0), 0.4) == pytest.approx((1.0, 99.0))
