"""Plans cut from meshes, and small pictures."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.reproduce.plan import from_above, outlines, solid
from sonarmap.tools.lab.simulate.shapes.solids import box, height_field, merge
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
