"""What the loops did: the map of chained registrations beside the optimized one, from above, in one frame."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.products.report.map_picture import draw_cloud, level_colors
from sonarmap.tools.products.report.small_png import write_png
from sonarmap.tools.products.report.survey.image import Cloud
from sonarmap.tools.products.report.survey.layout import extent_of, twice
from sonarmap.tools.products.report.survey.sheet import add_color_bar, open_sheet
from sonarmap.tools.products.report.survey.track import draw_track, inks_of, track_legend
from sonarmap.tools.products.report.survey.view import VERDICTS, PartView, Verdict

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_Loops = dict[Verdict, list[tuple[int, int]]]
_GRAYS = 0.2, 0.8  # of the gray color map, from low to high: the lines upon it have the colors
_INK = 60  # loops that are drawn in full width; more are drawn thinner, so that the map is seen between them
_CONCERN = 0.8  # least width of the others
_BULGE, _PIECES = 0.08, 8  # of a loop's bow [its length], and straight pieces that it is drawn of
_LOOKS: dict[Verdict, dict[str, Any]] = {  # colors that no kind of color blindness mixes up, and unlike dashes
    "kept": {"color": "#0072B2", "linestyle": "-"},
    "rejected": {"color": "#AA2277", "linestyle": (0, (6, 2))},
    "refused": {"color": "#E69F00", "linestyle": (0, (1.5, 1.5))},
}
_WORDS: dict[Verdict, str] = {
    "kept": "kept",
    "rejected": "rejected: the other pairs contradict",
    "refused": "refused by the registration itself",
}


def draw_loops(path: Path, view: PartView) -> None:
    """Write a PNG of two maps, before and after the loops, seen from above. The same view gives the same bytes.

    Raises InputError: the file cannot be written."""
    inks = [*inks_of(view), *(look["color"] for look in _LOOKS.values())]
    write_png(lambda: loops_figure(view), path, inks, _grays()[:, :3])


def loops_figure(view: PartView) -> "Figure":
    """The figure: two panels of the same extent and colors; the loops are drawn upon the second."""
    from matplotlib.colors import ListedColormap

    loops: _Loops = {verdict: view.loops(verdict) for verdict in VERDICTS}
    frame = view.frame
    clouds = [Cloud.of(point_map, frame) for point_map in (view.chained, view.point_map)]
    places = [frame.flat(each.T_world_sensor.translation) for each in (view.chained_poses, view.trajectory)]
    moved = view.trajectory.farthest_from(view.chained_poses)
    after = f"after: {_counted(loops['kept'])} kept" + (f", poses moved by up to {moved:.2g} m" if moved else "")
    sheet = open_sheet(
        twice(*extent_of([cloud.flat for cloud in clouds], places)),
        (f"{view.title}: before and after the loops" if view.title else "Before and after the loops", view.size),
        frame,
        [*track_legend(view, numbers=False), *_legend(loops)],
        frame.note,
        panel_titles=("before: consecutive registrations, chained", after),
    )
    panels = [axes for row in sheet.panels for axes in row]
    colors = level_colors(view, ListedColormap(_grays()))
    for axes, cloud, track in zip(panels, clouds, places, strict=True):
        draw_cloud(axes, cloud, frame, colors)
        draw_track(axes, view, track, numbers=False)
    _draw_loops(panels[1], places[1], loops)
    add_color_bar(sheet, colors, frame)
    return sheet.figure


def _grays() -> np.ndarray:
    """(256, 4) colors 0..1 from low to high."""
    from matplotlib import colormaps

    return colormaps["Greys"](np.linspace(*_GRAYS, 256))


def _draw_loops(axes: "Axes", places: np.ndarray, loops: _Loops) -> None:
    """A bow between the scans of every loop, which is seen beside a straight track."""
    from matplotlib.collections import LineCollection

    width = float(np.clip(_INK / max(1, sum(map(len, loops.values()))), 0.35, 1.0))
    along = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    for verdict, pairs in loops.items():
        ends = places[np.array(pairs, np.intp).reshape(-1, 2)]
        start, step = ends[:, :1], ends[:, 1:] - ends[:, :1]
        across = step[..., ::-1] * np.array([-1.0, 1.0])
        bows = start + along * step + 4 * _BULGE * along * (1 - along) * across
        look = {"colors": _LOOKS[verdict]["color"], "alpha": 0.7, "linestyles": [_LOOKS[verdict]["linestyle"]]}
        drawn = width if verdict == "kept" else max(width, _CONCERN)
        lines = LineCollection(list(bows), linewidths=drawn, zorder=3 if verdict == "kept" else 4, **look)
        axes.add_collection(lines, autolim=False)


def _legend(loops: _Loops) -> list["Artist"]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], linewidth=1.5, label=f"{_counted(pairs)} {_WORDS[verdict]}", **_LOOKS[verdict])
        for verdict, pairs in loops.items()
        if pairs or verdict == "kept"
    ]


def _counted(loops: list[tuple[int, int]]) -> str:
    return counted(len(loops), "loop") if loops else "no loops"
