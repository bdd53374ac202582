"""The map from above, with the track: one PNG."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.products.report.small_png import write_png
from sonarmap.tools.products.report.survey.frame import MapFrame
from sonarmap.tools.products.report.survey.image import Cloud, color_range, seen_from_above
from sonarmap.tools.products.report.survey.layout import extent_of, layout
from sonarmap.tools.products.report.survey.sheet import add_color_bar, open_sheet
from sonarmap.tools.products.report.survey.track import draw_track, inks_of, track_legend
from sonarmap.tools.products.report.survey.view import PartView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

_COLORS = "viridis"  # even to the eye, in gray prints, and to the color-blind; the report has the same


def draw_map(path: Path, view: PartView) -> None:
    """Write a PNG of a part of the map, seen from above, colored by depth. The same view gives the same bytes.

    Raises InputError: the file cannot be written."""
    from matplotlib import colormaps

    write_png(lambda: map_figure(view), path, inks_of(view), colormaps[_COLORS](np.linspace(0, 1, 256))[:, :3])


def map_figure(view: PartView) -> "Figure":
    """The figure: the map on one panel, or in strips to one scale where it is long and narrow."""
    frame, cloud = view.frame, Cloud.of(view.point_map, view.frame)
    places = frame.flat(view.trajectory.T_world_sensor.translation)
    lower, upper = extent_of([cloud.flat], [places])
    plan = layout(lower, upper)
    sheet = open_sheet(
        plan,
        (view.title or "Map", view.size),
        frame,
        track_legend(view),
        "\n".join([frame.note, *plan.strips, *_left_out(view, cloud, lower, upper)]),
    )
    colors = level_colors(view, _COLORS)
    for axes in (axes for row in sheet.panels for axes in row):
        draw_cloud(axes, cloud, frame, colors)
        draw_track(axes, view, places)
    add_color_bar(sheet, colors, frame)
    return sheet.figure


def level_colors(view: PartView, colors: "str | Colormap") -> "ScalarMappable":
    """The colors of depths or heights; what lies deeper has the color of lower heights, whichever is shown."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    chosen = colormaps[colors] if isinstance(colors, str) else colors
    levels = view.frame.level(view.point_map.points[:, 2])
    ordered = chosen if view.frame.zero is None else chosen.reversed()
    return ScalarMappable(Normalize(*color_range(levels, view.point_map.voxel)), ordered)


def draw_cloud(axes: "Axes", cloud: Cloud, frame: MapFrame, colors: "ScalarMappable") -> None:
    """Points from above as an image, a pixel of it a pixel of the sheet, below the axes."""
    figure, box = axes.get_figure(root=True), axes.get_window_extent()
    assert figure is not None
    pixel = float(np.diff(axes.get_xlim())[0]) / box.width
    left, lower = math.floor(box.x0), math.floor(box.y0)
    corner = np.array([axes.get_xlim()[0], axes.get_ylim()[0]]) - pixel * np.array([box.x0 - left, box.y0 - lower])
    shape = math.ceil(box.y1) - lower, math.ceil(box.x1) - left
    seen = frame.level(seen_from_above(cloud.flat, cloud.z, corner, shape, pixel, cloud.voxel))
    look = {"cmap": colors.get_cmap(), "norm": colors.norm}
    image = figure.figimage(np.ma.masked_invalid(seen), left, lower, origin="lower", **look)
    image.set_zorder(-1)
    axes.patch.set_visible(False)


def _left_out(view: PartView, cloud: Cloud, lower: np.ndarray, upper: np.ndarray) -> list[str]:
    """What of the survey's echoes the picture does not show."""
    sentences: list[str] = []
    if doubted := view.point_map.doubted:
        sentences.append(f"{doubted:,} more points, seen by too few scans, may be false echoes and are left out.")
    outside = int(np.count_nonzero(((cloud.flat < lower) | (cloud.flat > upper)).any(axis=1))) + cloud.lone
    if outside:
        sentences.append(
            f"Not drawn: {counted(outside, 'point')} of the map that stand{'s' if outside == 1 else ''} alone."
        )
    return [" ".join(sentences)] if sentences else []
