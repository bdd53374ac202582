"""What the loops did: the map of chained registrations beside the optimized one, from above, in one frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slam.graph.trajectory import Trajectory
from slam.map.point_map import PointMap
from tools.report.map_picture import heights_of, scatter_from_above
from tools.report.small_png import save_small

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KEPT, _REFUSED, _TRAJECTORY = "tab:green", "tab:red", "tab:blue"
_GRAYS = 0.25, 0.95  # of the gray color map, from low to high: the lines upon it have the colors
_INK = 100  # loops that are drawn in full width; more are drawn thinner, so that the map is seen between them
_MARGIN = 0.03  # around the points [longer side]


def draw_loops(
    path: Path,
    chained: tuple[PointMap, Trajectory],
    optimized: tuple[PointMap, Trajectory],
    kept: Sequence[tuple[int, int]],
    refused: Sequence[tuple[int, int]],
) -> None:
    """Write a PNG of two maps side by side, seen from above (x to the right, y up), the higher the darker.

    Args:
        path: the file.
        chained: the map and the poses of one component by consecutive registrations alone.
        optimized: the same with the loops, in the same frame.
        kept, refused: loops, as places in the trajectories.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    both = (chained, optimized)
    clouds = [point_map.points for point_map, _ in both]
    lower, upper = _extent(clouds + [trajectory.T_world_sensor.translation for _, trajectory in both])
    heights = heights_of(optimized[0].points)
    grays = ListedColormap(colormaps["Greys"](np.linspace(*_GRAYS, 256)))
    width, height = (upper - lower).tolist()
    figure = Figure(figsize=(14, float(np.clip(1.3 + 6.0 * height / width, 4.0, 12.0))), dpi=140, layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    titles = ("before: consecutive registrations, chained", f"after: {_counted(kept)} kept, poses optimized")
    for axes, title, (point_map, trajectory) in zip(panels, titles, both, strict=True):
        scatter_from_above(axes, point_map.points, heights, grays)
        _draw_loops(axes, trajectory, kept, refused)
        axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), aspect="equal", xlabel="x [m]")
        axes.set_title(title)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("y [m]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.colorbar(panels[1].collections[0], ax=panels, label="height z [m]", shrink=0.8, pad=0.01)
    save_small(figure, path)


def _draw_loops(
    axes: "Axes", trajectory: Trajectory, kept: Sequence[tuple[int, int]], refused: Sequence[tuple[int, int]]
) -> None:
    """The trajectory, and a line between the scans of every loop."""
    from matplotlib.collections import LineCollection

    places = trajectory.T_world_sensor.translation[:, :2]
    axes.plot(*places.T, "-", color=_TRAJECTORY, linewidth=1.0, marker="o", markersize=2.0, label="sensor", zorder=4)
    width = float(np.clip(_INK / max(1, len(kept) + len(refused)), 0.4, 1.0))
    for pairs, color, style, name in ((kept, _KEPT, "-", "kept"), (refused, _REFUSED, (0, (4, 3)), "refused")):
        ends = [places[list(pair)] for pair in pairs]
        label = f"{_counted(pairs)} {name}"
        axes.add_collection(
            LineCollection(ends, colors=color, linestyles=[style], linewidths=width, label=label, zorder=3)
        )


def _counted(loops: Sequence[tuple[int, int]]) -> str:
    return "1 loop" if len(loops) == 1 else f"{len(loops) or 'no'} loops"


def _extent(clouds: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The corners (2,) [m] of all points and places from above, and a margin."""
    points = np.concatenate(clouds)[:, :2]
    lower, upper = points.min(axis=0), points.max(axis=0)
    margin = _MARGIN * max(1.0, (upper - lower).max())
    return lower - margin, upper + margin
