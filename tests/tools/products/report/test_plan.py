"""Plans cut from meshes, beside solids whose sections are known."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.reproduce.plan import from_above, outlines, solid
from sonarmap.tools.lab.simulate.shapes.solids import box, height_field, merge
from sonarmap.tools.products.report.small_png import save_small

TURN = Rotation.from_euler("z", 0.5)


class TestOutlines:
    def test_a_turned_boxs_section_is_its_rectangle(self) -> None:
        pieces = outlines(box((3, -5, 2), (8, 3, 4), TURN), 1.0)
        ends = TURN.inv().apply(np.dstack([pieces, np.ones(pieces.shape[:2])]).reshape(-1, 3) - [3, -5, 1])
        near = np.abs(np.abs(ends[:, :2]) - (4, 1.5))
        assert near.min(axis=1).max() < 1e-9
        assert np.linalg.norm(np.diff(pieces, axis=1), axis=2).sum() == pytest.approx(22)

    def test_none_above_and_below(self) -> None:
        assert len(outlines(box((3, -5, 2), (8, 3, 4)), 4.5)) == 0
        assert len(outlines(box((3, -5, 2), (8, 3, 4)), -0.5)) == 0


class TestSolid:
    def test_overlapping_boxes_and_the_ground(self) -> None:
        """Where two solids overlap is inside; so is what lies under a slope that rises along x."""
        axis = np.linspace(-16, 16, 9)
        slope = height_field(axis, axis, np.repeat(axis[:, None], 9, axis=1) - 10.0)
        scene = merge([box((-6, 0, 0), (8, 4, 4)), box((-4, 0, 0), (4, 12, 2)), box((-6, 10, 5), (4, 4, 4)), slope])
        inside = solid(scene, 0.0, edge=32.0, cell=1.0)
        place = np.arange(32) + 0.5 - 16
        x, y = np.meshgrid(place, place, indexing="ij")
        wanted = ((np.abs(x + 6) < 4) & (np.abs(y) < 2)) | ((np.abs(x + 4) < 2) & (np.abs(y) < 6)) | (x > 10)
        assert (inside == wanted).all()


class TestFromAbove:
    def test_the_highest_hides_the_others_and_the_axes_are_in_order(self) -> None:
        points = np.array([[1.2, -0.8, 3], [1.4, -0.6, 5], [1.3, -0.7, 4], [-1.9, 1.9, 0], [9, 0, 0]])
        seen = from_above(points, np.array([10.0, 20, 30, 40, 50]), edge=4.0, cell=1.0)
        assert seen[3, 1] == 20
        assert seen[0, 3] == 40
        assert np.isfinite(seen).sum() == 2


class TestSmallPng:
    def test_white_stays_white_and_twice_is_the_same(self, tmp_path: Path) -> None:
        from matplotlib.figure import Figure
        from PIL import Image

        figure = Figure(figsize=(3, 2))
        figure.subplots().imshow(np.random.default_rng(1).random((40, 60)), cmap="viridis")
        for name in "ab":
            save_small(figure, tmp_path / f"{name}.png")
        figure.savefig(tmp_path / "large.png")
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
        assert (tmp_path / "a.png").stat().st_size < (tmp_path / "large.png").stat().st_size
        with Image.open(tmp_path / "a.png") as image:
            assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)
