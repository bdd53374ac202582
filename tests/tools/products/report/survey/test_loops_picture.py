"""What loops.png shows: the same sheet twice, and every loop by its verdict."""

from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from sonarmap.tools.products.report.loops_picture import loops_figure
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


def view(count: int = 40, loops: int = 12, width: float = 90, height: float = 60) -> PartView:
    """Of every six loops four are kept, one was refused, and one rejected by the others."""
    apart = min(5, count - 1)
    starts = [k % (count - apart) for k in range(loops)]
    tried = [pair(i, i + apart, "loop", k % 6 < 4, k % 6 != 4) for k, i in enumerate(starts)]
    moved = bed(width, height, 0, 3)
    return view_of(bed(width, height), track(width, height, count), tuple(tried), chained=cloud(moved), frame=SEA)


def lines_of(figure: Figure) -> list[Any]:
    return [
        each
        for axes in figure.axes
        for each in axes.collections
        if isinstance(each, LineCollection) and each.get_segments()
    ]


@pytest.mark.parametrize(
    "shown",
    [view(), view(loops=0), view(loops=500), view(3, 1), view(30, 20, 900, 20), view(30, 20, 20, 900)],
    ids=["some", "none", "500", "one loop", "long", "tall"],
)
def test_no_text_lies_upon_another_or_leaves_the_sheet(shown: PartView) -> None:
    assert overlapping_texts(loops_figure(shown)) == []


def test_both_panels_have_the_same_extent_and_colors() -> None:
    figure = loops_figure(view())
    before, after = (axes for axes in figure.axes if axes.get_xlabel() == "East [m]")
    assert (before.get_xlim(), before.get_ylim()) == (after.get_xlim(), after.get_ylim())
    assert before.get_ylim()[1] > 63  # where the map of the chain ends
    first, second = figure.images
    assert first.get_clim() == second.get_clim()
    assert first.cmap == second.cmap
    assert before.get_title() == "before: consecutive registrations, chained"
    assert after.get_title() == "after: 8 loops kept"
    assert figure.texts[0].get_text() == "harbor, 2024-05-17: before and after the loops"


def test_the_map_of_the_chain_is_before() -> None:
    """It lies 3 m farther up."""
    figure = loops_figure(view())
    tops = []
    images: list[Any] = list(figure.images)
    for image, axes in zip(images, figure.axes, strict=False):
        shown = ~np.ma.getmaskarray(levels_of(image))
        top = np.flatnonzero(shown.any(axis=1)).max() + image.oy
        tops.append(axes.transData.inverted().transform([0, top])[1])
    assert tops[0] - tops[1] == pytest.approx(3, abs=0.3)


def test_loops_are_drawn_by_verdict_and_counted() -> None:
    shown = view()
    figure = loops_figure(shown)
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels[-3:] == [
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


def test_many_loops_are_thin() -> None:
    few, many = (lines_of(loops_figure(view(loops=count)))[0].get_linewidth()[0] for count in (6, 500))
    assert many < 0.5 < few


def test_verdicts() -> None:
    assert verdict_of(pair(0, 5, "loop", kept=True, accepted=False)) == "kept"
    assert verdict_of(pair(0, 5, "loop", kept=False, accepted=True)) == "rejected"
    assert verdict_of(pair(0, 5, "loop", kept=False, accepted=False)) == "refused"
