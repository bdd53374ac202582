"""Plans cut from meshes, and labels that do not overlap."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from PIL import Image
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.reproduce.plan import from_above, outlines, solid
from sonarmap.tools.lab.simulate.shapes.solids import box, height_field, merge
from sonarmap.tools.products.report.labels import place_labels
from sonarmap.tools.products.report.small_png import save_small

TURN = Rotation.from_euler("z", 0.5)


def test_a_turned_boxs_section_is_its_rectangle() -> None:
    pieces = outlines(box((3, -5, 2), (8, 3, 4), TURN), 1.0)
    ends = TURN.inv().apply(np.dstack([pieces, np.ones(pieces.shape[:2])]).reshape(-1, 3) - [3, -5, 1])
    near = np.abs(np.abs(ends[:, :2]) - (4, 1.5))
    assert near.min(axis=1).max() < 1e-9
    assert np.linalg.norm(np.diff(pieces, axis=1), axis=2).sum() == pytest.approx(22)
    for height in (4.5, -0.5):  # above and below
        assert len(outlines(box((3, -5, 2), (8, 3, 4)), height)) == 0


def test_overlapping_boxes_and_the_ground_are_solid() -> None:
    """Where two solids overlap is inside; so is what lies under a slope that rises along x."""
    axis = np.linspace(-16, 16, 9)
    slope = height_field(axis, axis, np.repeat(axis[:, None], 9, axis=1) - 10.0)
    scene = merge([box((-6, 0, 0), (8, 4, 4)), box((-4, 0, 0), (4, 12, 2)), box((-6, 10, 5), (4, 4, 4)), slope])
    place = np.arange(32) + 0.5 - 16
    x, y = np.meshgrid(place, place, indexing="ij")
    wanted = ((np.abs(x + 6) < 4) & (np.abs(y) < 2)) | ((np.abs(x + 4) < 2) & (np.abs(y) < 6)) | (x > 10)
    assert (solid(scene, 0.0, edge=32.0, cell=1.0) == wanted).all()


def test_from_above_the_highest_hides_the_others_and_the_axes_are_in_order() -> None:
    points = np.array([[1.2, -0.8, 3], [1.4, -0.6, 5], [1.3, -0.7, 4], [-1.9, 1.9, 0], [9, 0, 0]])
    seen = from_above(points, np.array([10.0, 20, 30, 40, 50]), edge=4.0, cell=1.0)
    assert (seen[3, 1], seen[0, 3], np.isfinite(seen).sum()) == (20, 40, 2)


def test_in_a_small_png_white_stays_white_and_twice_is_the_same(tmp_path: Path) -> None:
    figure = Figure(figsize=(3, 2))
    figure.subplots().imshow(np.random.default_rng(1).random((40, 60)), cmap="viridis")
    first, second, large = (tmp_path / f"{name}.png" for name in ("a", "b", "large"))
    save_small(figure, first)
    save_small(figure, second)
    figure.savefig(large)
    assert first.read_bytes() == second.read_bytes()
    assert first.stat().st_size < large.stat().st_size
    with Image.open(first) as image:
        assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)


def axes_of(width: float = 6.0) -> Axes:
    axes = Figure(figsize=(width, 4), dpi=100).add_subplot()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    return axes


def boxes_of(labels: list[Annotation]) -> list:
    """Of labels, none of which touches another."""
    boxes = [label.get_window_extent() for label in labels]
    assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])]
    return boxes


@pytest.mark.parametrize("seed", range(4))
def test_no_two_touch_and_all_are_inside(seed: int) -> None:
    axes, rng = axes_of(), np.random.default_rng(seed)
    places = rng.uniform(0, 1, (60, 2))
    labels = place_labels(axes, places, [f"label {k}" for k in range(60)])
    boxes = boxes_of(labels)
    assert 15 < len(labels) < 60
    frame = axes.get_window_extent()
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1 for box in boxes)
    named = {label.get_text(): label.xy for label in labels}
    assert all(named[name] == pytest.approx(places[int(name.split()[1])]) for name in named)


def test_crowded_labels_find_room_farther_away_with_a_line() -> None:
    axes = axes_of()
    places = np.full((7, 2), 0.5) + 0.01 * np.random.default_rng(1).normal(size=(7, 2))
    labels = place_labels(axes, places, list("abcdefg"), distances=(5.0, 20.0, 40.0, 70.0), fontsize=14)
    assert len(boxes_of(labels)) > 5
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
    axes = axes_of(0.3)  # what has no room is left out
    assert place_labels(axes, np.array([[0.5, 0.5]]), ["a long label that fits nowhere"]) == []
    assert len(axes.texts) == 0
