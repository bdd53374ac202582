"""Drawing a true plan, and points from above upon it."""

from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.lab.reproduce.plan import SectionPlan

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SOLID = "0.72"


def draw_plan(
    axes: "Axes", plan: SectionPlan, *, filled: bool = True, color: str = "black", width: float = 0.6
) -> None:
    """The plan's solids in gray where `filled`, and its outlines over whatever was drawn before."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    half = plan.edge / 2
    if filled:
        shown = np.ma.masked_equal(plan.solid.T.astype(np.uint8), 0)
        colors = ListedColormap([_SOLID])
        axes.imshow(shown, origin="lower", extent=(-half, half, -half, half), cmap=colors, interpolation="nearest")
    axes.add_collection(LineCollection(list(plan.outlines), colors=color, linewidths=width, zorder=4))


def from_above(points: np.ndarray, values: np.ndarray, edge: float, cell: float) -> np.ndarray:
    """What is seen of points from above: (K, K) float64, [i, j] at x index i and y index j, NaN where there is none.

    Args:
        points: (N, 3) [m].
        values: (N,) of the points; the highest point of a cell hides the others.
        edge: side of the square about the origin that is seen [m].
        cell: side of a cell [m].
    """
    count = round(edge / cell)
    i, j = np.floor((points[:, :2] + edge / 2) / cell).astype(int).T
    within = (i >= 0) & (i < count) & (j >= 0) & (j < count)
    order = np.flatnonzero(within)[np.argsort(points[within, 2], kind="stable")]
    seen = np.full((count, count), np.nan)
    seen[i[order], j[order]] = values[order]  # of cells named twice the last stays: the highest
    return seen
