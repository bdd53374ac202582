"""A log of navigation by itself: its track, and what it measured over time, with the rows that cannot be. One PNG."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.files.readers.navigation.overview import LogOverview
from sonarmap.tools.files.readers.navigation.rows import KINDS
from sonarmap.tools.products.png import write_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE, _DPI = (11.7, 8.3), 140  # A4 landscape
_GOOD, _WRONG = "#0072B2", "#D55E00"
_SERIES = {"roll": [0], "pitch": [1], "heading": [2], "depth": [5]}
_UNITS = {"roll": "roll [°]", "pitch": "pitch [°]", "heading": "heading [°]", "depth": "depth [m]"}
_OUTSIDE = 0.5  # of the good rows' extent, beyond which a wrong place is not shown


def draw_log(found: LogOverview, path: Path) -> None:
    """Write a PNG of the log. The same log gives the same bytes. Raises InputError: the file cannot be written."""
    write_png(log_figure(found), path)


def log_figure(found: LogOverview) -> "Figure":
    """The figure: the track to the left, what is measured over time to the right."""
    from matplotlib.figure import Figure

    shown = [name for name, columns in _SERIES.items() if np.isfinite(found.log.values[:, columns]).any()]
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    grid = figure.add_gridspec(
        max(1, len(shown)), 2, width_ratios=(1.2, 1.0), left=0.07, right=0.98, top=0.9, hspace=0.15
    )
    left = f", {len(found.faults):,} left out" if found.faults else ""
    figure.suptitle(f"{found.path.name}: {len(found.log.lines):,} rows{left}", fontsize=15, weight="bold")
    _draw_track(figure.add_subplot(grid[:, 0]), found)
    times = found.log.times if found.clock else np.arange(len(found.log.times), dtype=np.float64)
    times = times - np.nanmin(times)
    first = None
    for row, name in enumerate(shown):
        axes = figure.add_subplot(grid[row, 1], sharex=first)
        first = first or axes
        _draw_series(axes, found, times, name)
        axes.tick_params(labelbottom=row == len(shown) - 1)
    if shown:
        figure.axes[-1].set_xlabel("time from the first row [s]" if found.clock else "row")
    return figure


def _draw_track(axes: "Axes", found: LogOverview) -> None:
    good, given = found.usable.values[:, KINDS["position"]], found.log.values[:, KINDS["position"]]
    known = np.isfinite(good).all(axis=1)
    axes.set_xlabel("East [m]")
    axes.set_ylabel("North [m]")
    axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
    if not known.any():
        axes.text(0.5, 0.5, "no places", transform=axes.transAxes, ha="center")
        return
    axes.plot(*good[known].T, color=_GOOD, linewidth=1.2, marker=".", markersize=3, label="places")
    axes.plot(*good[known][0], "o", color=_GOOD, markersize=9, fillstyle="none", label="start")
    low, high = good[known].min(axis=0), good[known].max(axis=0)
    room = _OUTSIDE * max(float((high - low).max()), 1.0)
    wrong = given[~known & np.isfinite(given).all(axis=1)]
    near = ((wrong >= low - room) & (wrong <= high + room)).all(axis=1)
    if len(wrong):
        far = f", {(~near).sum()} of them beyond the picture" if not near.all() else ""
        axes.plot(*wrong[near].T, "x", color=_WRONG, label=f"{len(wrong)} left out{far}")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="best", fontsize=9)


def _draw_series(axes: "Axes", found: LogOverview, times: np.ndarray, name: str) -> None:
    good, given = (log.values[:, _SERIES[name]][:, 0] for log in (found.usable, found.log))
    axes.plot(times, good, ".", color=_GOOD, markersize=2)
    wrong = np.isnan(good) & np.isfinite(given)
    axes.plot(times[wrong], given[wrong], "x", color=_WRONG)
    axes.set_ylabel(_UNITS[name])
    axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
    if name == "depth":
        axes.invert_yaxis()
