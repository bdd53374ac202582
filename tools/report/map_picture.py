"""The map from above, with the trajectory: one PNG."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slam.graph.trajectory import Trajectory
from slam.map.point_map import PointMap
from tools.writers.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from matplotlib.colors import Colormap

_DOTS = 400_000  # more points than this are thinned: the picture has no more pixels to show them


def draw_map(path: Path, point_map: PointMap, trajectory: Trajectory, names: Sequence[str], title: str) -> None:
    """Write a PNG of one component's map, seen from above (x to the right, y up), colored by height.

    Args:
        path: the file.
        point_map: of the component.
        trajectory: of its scans, whose `names` are given in the same order.
        title: a line over the picture.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    figure = Figure(figsize=(10, 8), dpi=140, layout="constrained")
    axes = figure.add_subplot()
    dots = scatter_from_above(axes, point_map.points, heights_of(point_map.points))
    places = trajectory.T_world_sensor.translation
    axes.plot(*places[:, :2].T, "-", color="tab:red", linewidth=1.5, marker="o", markersize=4, label="sensor")
    halo = [withStroke(linewidth=3, foreground="white")]
    for k, offset in ((0, (8, 8)), (len(names) - 1, (8, -14))):
        style = {"color": "tab:red", "fontsize": 9, "path_effects": halo}
        axes.annotate(_shown(names[k]), places[k, :2], xytext=offset, textcoords="offset points", **style)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    figure.colorbar(dots, ax=axes, label="height z [m]", shrink=0.8)
    with atomic_path(path) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names in other scripts are drawn as boxes
        figure.savefig(temporary, format="png")


def heights_of(points: np.ndarray) -> tuple[float, float]:
    """The lowest and the highest z of points (n, 3) between which the colors change [m]."""
    low, high = np.quantile(points[:, 2], [0.01, 0.99]).tolist()
    return low, high


def scatter_from_above(
    axes: "Axes", points: np.ndarray, heights: tuple[float, float], colors: "str | Colormap" = "viridis"
) -> "PathCollection":
    """Points (n, 3) [m] from above as dots, colored from the lower to the upper of `heights` [m]."""
    low, high = heights
    points = points[:: max(1, -(-len(points) // _DOTS))]
    points = points[np.argsort(points[:, 2], kind="stable")]  # what is higher hides what is below it
    size = float(np.clip(2e5 / len(points), 0.3, 12.0))
    return axes.scatter(*points[:, :2].T, c=points[:, 2], s=size, cmap=colors, vmin=low, vmax=high, linewidths=0)


def _shown(name: str) -> str:
    """A scan's name as one line of text: a dollar sign begins no formula."""
    return "".join(c if c.isprintable() else "?" for c in name).replace("$", r"\$")
