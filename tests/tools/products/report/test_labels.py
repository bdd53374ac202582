"""Labels that overlap nothing."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from sonarmap.tools.products.report.labels import place_labels


def axes_of(width: float = 6.0) -> Axes:
    axes = Figure(figsize=(width, 4), dpi=100).add_subplot()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    return axes


def boxes_of(labels: list[Annotation]) -> list:
    return [label.get_window_extent() for label in labels]


@pytest.mark.parametrize("seed", range(4))
def test_no_two_touch_and_all_are_inside(seed: int) -> None:
    axes, rng = axes_of(), np.random.default_rng(seed)
    places = rng.uniform(0, 1, (60, 2))
    labels = place_labels(axes, places, [f"label {k}" for k in range(60)])
    boxes = boxes_of(labels)
    assert 15 < len(labels) < 60
    assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])]
    frame = axes.get_window_extent()
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1 for box in boxes)
    named = {label.get_text(): label.xy for label in labels}
    assert all(named[name] == pytest.approx(places[int(name.split()[1])]) for name in named)


def test_crowded_labels_find_room_farther_away_with_a_line() -> None:
    axes = axes_of()
    places = np.full((7, 2), 0.5) + 0.01 * np.random.default_rng(1).normal(size=(7, 2))
    labels = place_labels(axes, places, list("abcdefg"), distances=(5.0, 20.0, 40.0, 70.0), fontsize=14)
    assert len(labels) > 5
    assert not [pair for pair in combinations(boxes_of(labels), 2) if pair[0].overlaps(pair[1])]
    lines = [text for text in axes.texts if isinstance(text, Annotation) and text.arrow_patch is not None]
    assert len(lines) > 1


def test_labels_keep_off_what_is_taken_and_rather_off_what_they_would_cover() -> None:
    axes = axes_of()
    x, y = axes.transData.transform([0.5, 0.5])
    (label,) = place_labels(axes, np.array([[0.5, 0.5]]), ["here"], taken=[(x, y - 50, x + 200, y + 50)])
    assert label.get_window_extent().x1 < x
    line = np.column_stack([np.linspace(0.5, 1, 200), np.full(200, 0.5)])
    (label,) = place_labels(axes_of(), np.array([[0.5, 0.5]]), ["here"], covered=line)
    assert label.get_window_extent().y0 > y


def test_what_has_no_room_is_left_out() -> None:
    axes = axes_of(0.3)
    assert place_labels(axes, np.array([[0.5, 0.5]]), ["a long label that fits nowhere"]) == []
    assert len(axes.texts) == 0
