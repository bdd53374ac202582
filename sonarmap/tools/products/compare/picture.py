"""A comparison from above: distances in color, what cannot be said gray, the regions numbered with their volumes."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.products.compare.comparison import Comparison
from sonarmap.tools.products.compare.distances import Distances, Verdict
from sonarmap.tools.products.png import write_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _BESIDE, _HEIGHTS, _DPI = 7.6, (2.4, 1.6), (3.0, 10.0), 140  # of the axes, and of what is beside them [in]
_TEXT, _LINE_LENGTH = 9.0, 110  # [pt]; characters of a line below the title
_COLORS, _UNKNOWN, _INK = "RdBu", "#B8B8B8", "#000000"
_LARGEST = 0.98  # quantile of significant distances at which colors end
_LISTED = 12  # regions that are labeled; all are outlined


def draw_changes(path: Path, comparison: Comparison) -> None:
    """Write a PNG of a comparison. Raises InputError: the file cannot be written."""
    write_png(changes_figure(comparison), path)


def changes_figure(comparison: Comparison) -> "Figure":
    """The figure: x and y of the old map's frame, to one scale."""
    from matplotlib.figure import Figure

    distances, points = comparison.distances, comparison.distances.cores.points
    extent = np.maximum(np.ptp(points[:, :2], axis=0), distances.voxel)
    tall = float(np.clip(_WIDTH * extent[1] / extent[0], *_HEIGHTS))
    figure = Figure(figsize=(_WIDTH + _BESIDE[0], tall + _BESIDE[1]), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal", adjustable="datalim")
    # a core point is about a voxel wide
    size = (72 * min(_WIDTH / extent[0], tall / extent[1]) * distances.voxel) ** 2
    known, most = _colored(distances)
    unknown = points[~known]
    axes.scatter(
        unknown[:, 0], unknown[:, 1], size, _UNKNOWN, edgecolor="none", rasterized=True, label="cannot be said"
    )
    order = np.flatnonzero(known)[np.argsort(points[known, 2], kind="stable")]
    x, y = points[order, :2].T
    dots = axes.scatter(x, y, size, distances.distance[order], cmap=_COLORS, vmin=-most, vmax=most)
    dots.set(edgecolor="none", rasterized=True)
    _outline(axes, comparison)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="upper right", fontsize=_TEXT, markerscale=2)
    figure.colorbar(dots, ax=axes, extend="both", label="distance along the normal [m]: gained positive, lost negative")
    first, *more = str(comparison).splitlines()
    count = len(comparison.regions)
    figure.suptitle(f"{count} changed region{'' if count == 1 else 's'}")
    below = f"{first.rpartition(': ')[2]}; {'; '.join(line.strip() for line in more)}"
    axes.set_title(textwrap.fill(below, _LINE_LENGTH), fontsize=_TEXT)
    return figure


def _colored(distances: Distances) -> tuple[np.ndarray, float]:
    """Which core points have a color, (K,) bool, as something can be said of them; and the distance at which colors end
    [m]."""
    known = np.isfinite(distances.distance) & (distances.verdict != Verdict.UNSURE)
    beyond = np.isin(distances.verdict, (Verdict.GAINED, Verdict.LOST))
    shown = np.abs(distances.distance[beyond if beyond.any() else known])
    return known, max(float(np.quantile(shown, _LARGEST)) if len(shown) else 0.0, 1e-3)


def _outline(axes: "Axes", comparison: Comparison) -> None:
    """A frame around each region, with its number and, for the largest, its volume."""
    from matplotlib.patches import Rectangle

    margin = comparison.distances.voxel
    for number, region in enumerate(comparison.regions, 1):
        low, wide = region.low[:2] - margin, region.high[:2] - region.low[:2] + 2 * margin
        axes.add_patch(Rectangle((low[0], low[1]), wide[0], wide[1], fill=False, edgecolor=_INK, linewidth=1.0))
        words = f"{number}: {region.volume:+,.1f} ± {region.sigma:.1f} m³" if number <= _LISTED else str(number)
        axes.annotate(words, (low[0], low[1] + wide[1]), (0, 2), textcoords="offset points", fontsize=_TEXT - 1)
