"""Distances to a surface, beside what can be worked out by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, height_field, merge
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance, triangle_distance

TURN = Rotation.from_euler("ZYX", [0.7, -0.3, 0.2])
CENTER, SIZE = np.array([30.0, -12.0, -7.0]), np.array([8.0, 3.0, 5.0])


def box_distance(points: np.ndarray) -> np.ndarray:
    """To the turned box's surface: outside by the part that sticks out, inside by the nearest face."""
    out = np.abs(TURN.inv().apply(points - CENTER)) - SIZE / 2
    outside = np.linalg.norm(np.maximum(out, 0), axis=1)
    return np.where((out <= 0).all(axis=1), -out.max(axis=1), outside)


class TestSurfaceDistance:
    def test_a_turned_box_inside_and_outside(self) -> None:
        """Random places meet its faces, edges and corners."""
        points = CENTER + np.random.default_rng(1).uniform(-12, 12, (4000, 3))
        found = surface_distance(box(CENTER, SIZE, TURN), points)
        assert found == pytest.approx(box_distance(points), abs=1e-5)

    def test_a_sloping_plane(self) -> None:
        """z = 0.5 x - 0.25 y over a field: n = (-0.5, 0.25, 1)."""
        x, y = np.linspace(-50, 50, 21), np.linspace(-40, 40, 9)
        field = height_field(x, y, 0.5 * x[:, None] - 0.25 * y[None, :])
        points = np.random.default_rng(2).uniform(-15, 15, (1000, 3))
        wanted = np.abs(points @ (-0.5, 0.25, 1.0)) / np.sqrt(0.5**2 + 0.25**2 + 1)
        assert surface_distance(field, points) == pytest.approx(wanted, abs=1e-5)

    def test_the_nearest_of_several_solids_counts(self) -> None:
        both = merge([box((0, 0, 0), (2, 2, 2)), box((10, 0, 0), (4, 2, 2))])
        points = np.array([[4.0, 0, 0], [5.0, 0, 0], [0, 0, 0], [0, 0, 3.5]])
        assert surface_distance(both, points) == pytest.approx([3, 3, 1, 2.5], abs=1e-6)

    def test_no_point(self) -> None:
        assert surface_distance(box((0, 0, 0), (2, 2, 2)), np.empty((0, 3))).shape == (0,)


class TestTriangleDistance:
    @pytest.mark.parametrize(
        ("point", "distance"),
        [((1, 1, 3), 3), ((1, -2, 0), 2), ((-3, -4, 0), 5), ((3, 3, 0), np.sqrt(2)), ((9, 0, 12), 13)],
    )
    def test_inside_over_a_side_and_beyond_a_corner(self, point: tuple[float, ...], distance: float) -> None:
        corners = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], float)
        for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
            assert triangle_distance(corners[:, order], np.array([point], float)) == pytest.approx([distance])

    def test_triangles_that_are_lines_or_dots(self) -> None:
        corners = np.array([[[0, 0, 0], [4, 0, 0], [2, 0, 0]], [[1, 1, 1]] * 3], float)
        points = np.array([[2, 3, 0], [1, 3, 1]], float)
        assert triangle_distance(corners, points) == pytest.approx([3, 2])
        flat = Mesh(np.concatenate(corners), np.array([[0, 1, 2], [3, 4, 5]]))
        assert np.isfinite(surface_distance(flat, points)).all()
