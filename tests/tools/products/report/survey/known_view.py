"""Parts of maps with known numbers, and what texts of a figure overlap."""

from itertools import combinations
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.pair import Pair, Role
from sonarmap.spectral.result import Registration
from sonarmap.tools.products.report.survey.frame import MapFrame
from sonarmap.tools.products.report.survey.view import PartView

FRAME = MapFrame("x [m]", "y [m]", "The direction of North is not known.", "height relative to the first scan [m]")
SEA = MapFrame("East [m]", "North [m]", "East and North count from here.", "depth [m]", zero=2.0, north=True)
_SPACE = 0.5  # by which boxes may touch [pixels]


def cloud(points: np.ndarray, voxel: float = 0.5, doubted: int = 0) -> PointMap:
    number, ones = np.zeros(len(points), np.int32), np.ones(len(points), np.int32)
    sigma = np.full(len(points), 0.1, np.float32)
    return PointMap(points, sigma, None, number, 2 * ones, ones, number, voxel, doubted=doubted)


def bed(width: float, height: float, x0: float = 0.0, y0: float = 0.0, step: float = 0.5) -> np.ndarray:
    """A bed from (x0, y0) to (x0 + width, y0 + height), z from -30 at its left to -10 at its right edge."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0, width, step), np.arange(0, height, step)))
    return np.column_stack([x + x0, y + y0, -30 + 20 * x / width])


def track(width: float, height: float, count: int, x0: float = 0.0, y0: float = 0.0) -> np.ndarray:
    """Places along the diagonal of such a bed, 5 m deep."""
    share = np.linspace(0, 1, count)[:, None]
    return np.hstack([share * [width, height] + np.array([x0, y0]), np.full((count, 1), -5.0)])


def pair(i: int, j: int, role: Role = "sequential", kept: bool = True, accepted: bool = True) -> Pair:
    registration = Registration(RigidTransform.identity(), np.eye(6), 9.0, 0.5 + i / 1000, accepted, 0.1)
    edge = Edge(i, j, registration, "loop" if role == "loop" else "sequential") if kept else None
    return Pair(i, j, role, registration=registration, edge=edge)


def view_of(points: np.ndarray, places: np.ndarray, pairs: tuple[Pair, ...] = (), **more: Any) -> PartView:
    count = len(places)
    poses = Trajectory(np.arange(count, dtype=np.float64), RigidTransform.from_translation(places))
    point_map = cloud(points, doubted=more.pop("doubted", 0))
    row: dict[str, Any] = {
        "title": "harbor, 2024-05-17",
        "size": f"{count} scans, {len(points):,} points, voxel 0.5 m",
        "frame": FRAME,
        "point_map": point_map,
        "trajectory": poses,
        "chained": point_map,
        "chained_poses": poses,
        "covariances": np.tile(np.diag([1e-4, 1e-4, 4e-4, 0.01, 0.04, 0.09]), (count, 1, 1)),
        "scans": tuple(range(count)),
        "names": tuple(f"scan_{k:03d}" for k in range(count)),
        "surveys": (0,) * count,
        "survey_names": {0: "survey 0"},
        "pairs": pairs,
    }
    return PartView(**row | more)


def levels_of(image: Any) -> np.ma.MaskedArray:
    """What an image shows [m], the lowest row first."""
    return np.ma.masked_invalid(image.get_array())


def overlapping_texts(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of texts that are drawn in a figure and whose boxes share pixels, and texts that leave the figure."""
    boxes: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def record(text: Text, renderer: RendererBase) -> None:
        if text.get_visible() and text.get_text().strip():
            boxes.append((text.get_text(), Text.get_window_extent(text, renderer)))
        draw(text, renderer)

    with patch.object(Text, "draw", record):
        FigureCanvasAgg(figure).draw()
    sheet = figure.bbox.padded(_SPACE)
    inside = {id(box) for _, box in boxes if sheet.contains(*box.min) and sheet.contains(*box.max)}
    outside = [(text, "the figure's edge") for text, box in boxes if id(box) not in inside]
    pairs = combinations([(text, box.padded(-_SPACE)) for text, box in boxes], 2)
    return outside + [(a, b) for (a, first), (b, second) in pairs if first.overlaps(second)]
