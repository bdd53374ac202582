"""A sheet of paper with maps: title, panels to one scale, color bar, North, scale bar, legend and notes.

Everything but the maps themselves stands beside them in strips of its own, measured in inches: nothing overlaps.
"""

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.products.report.labels import shrink
from sonarmap.tools.products.report.survey.frame import MapFrame
from sonarmap.tools.products.report.survey.layout import Layout

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

_DPI = 140
_LEFT, _RIGHT, _EDGE = 0.85, 1.5, 0.2  # of the panels: for numbers, for the scales; the sheet's margin [in]
_TITLE, _SUBTITLE = 17.0, 11.0  # [pt]
_TOP, _PANEL_TITLE = 0.95, 0.3  # above the panels [in]
_DIGITS = 5  # longer numbers along the vertical axis are turned
_LINE = 0.2  # of a note [in]
_NUMBERS = 0.62  # below the panels, for their numbers and label [in]
_ARROW, _BAR = 0.6, 0.55  # room of the North arrow and of the scale bar [in]
_TALLEST_BAR = 5.0  # the color bar [in]
TEXT = 11.0  # [pt]
_LEGEND: dict[str, Any] = {"frameon": False, "fontsize": TEXT, "borderpad": 0.1, "borderaxespad": 0.0}
_LEGEND |= {"columnspacing": 1.4, "handlelength": 1.6}


@dataclass(frozen=True, slots=True)
class Sheet:
    """figure: its size is final.
    panels: rows of axes, the upper row first; their limits are final.
    scales: left, lower side, width and height of the strip beside the panels, for the color bar [in]."""

    figure: "Figure"
    panels: list[list["Axes"]]
    scales: tuple[float, float, float, float]


def open_sheet(
    plan: Layout,
    words: tuple[str, str],
    frame: MapFrame,
    legend: list["Artist"],
    note: str,
    panel_titles: tuple[str, ...] = (),
) -> Sheet:
    """Lay out a sheet with panels by the plan and, row by row, their titles; `words` are title and subtitle, the note's
    sentences stand below, one a line. Where the frame's North is up, an arrow says so."""
    from matplotlib.figure import Figure

    width, height = plan.size
    figure = Figure(figsize=(_LEFT + width + _RIGHT, 10.0), dpi=_DPI)
    columns = (width + _RIGHT - _EDGE) * 72 / (0.5 * TEXT)
    lines = [line for sentence in note.splitlines() for line in textwrap.wrap(sentence, int(columns))]
    bottom = _EDGE + _LINE * len(lines)
    bottom += _add_legend(figure, legend, bottom) + _NUMBERS
    top = _TOP + (_PANEL_TITLE if panel_titles else 0.0)
    figure.set_size_inches(_LEFT + width + _RIGHT, bottom + height + top)
    _write_words(figure, words, lines)
    panels = [
        [_add_panel(figure, plan, row, column, bottom) for column in range(plan.windows.shape[1])]
        for row in range(plan.windows.shape[0])
    ]
    flat = [axes for row in panels for axes in row]
    for axes, title in zip(flat, panel_titles, strict=False):
        axes.set_title(title, fontsize=TEXT + 2)
    for axes in panels[-1]:
        axes.set_xlabel(frame.across, fontsize=TEXT)
    for row in panels:
        row[0].set_ylabel(frame.up, fontsize=TEXT)
    side = _LEFT + width + 0.15
    free = _add_scale_bar(figure, plan.scale, side, (bottom, bottom + height))
    if frame.north:
        free = _add_north(figure, side, free)
    return Sheet(figure, panels, (side, free[0], 0.2, free[1] - free[0]))


def add_color_bar(sheet: Sheet, colors: "ScalarMappable", frame: MapFrame) -> None:
    """The scale of depths or heights, with what they count from; depths grow downward."""
    left, lower, width, height = sheet.scales
    used = min(_TALLEST_BAR, height)
    axes = sheet.figure.add_axes(_share(sheet.figure, (left, lower + (height - used) / 2, width, used)))
    bar = sheet.figure.colorbar(colors, cax=axes, extend="both")
    bar.ax.tick_params(labelsize=TEXT)
    bar.set_label(textwrap.fill(frame.height, max(12, int(used * 72 / (0.52 * TEXT)))), fontsize=TEXT)
    if frame.zero is not None:
        axes.invert_yaxis()


def _share(figure: "Figure", inches: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Left, lower side, width and height [in] as shares of the figure."""
    width, height = figure.get_size_inches().tolist()
    return inches[0] / width, inches[1] / height, inches[2] / width, inches[3] / height


def _add_panel(figure: "Figure", plan: Layout, row: int, column: int, bottom: float) -> "Axes":
    x, y = plan.place(row, column)
    axes = figure.add_axes(_share(figure, (_LEFT + x, bottom + y, *plan.panel)))
    (left, lower), (right, upper) = plan.windows[row, column]
    axes.set(xlim=(left, right), ylim=(lower, upper))
    axes.tick_params(labelsize=TEXT)
    axes.locator_params(nbins=max(3, min(9, int(plan.panel[0] / 0.9))), axis="x")
    axes.locator_params(nbins=max(3, min(9, int(plan.panel[1] / 0.45))), axis="y")
    if max(len(f"{edge:.0f}") for edge in (lower, upper)) > _DIGITS:
        axes.tick_params(axis="y", labelrotation=90)
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
    axes.set_axisbelow(False)
    same_rows = column > 0 and (plan.windows[row, column, :, 1] == plan.windows[row, column - 1, :, 1]).all()
    axes.tick_params(labelleft=not same_rows)
    return axes


def _add_legend(figure: "Figure", entries: list["Artist"], bottom: float) -> float:
    """The legend at this height above the lower edge, in as few rows as fit; returns its height [in]."""
    if not entries:
        return 0.0
    room = (figure.get_figwidth() - _LEFT - _EDGE) * figure.dpi
    for columns in range(len(entries), 0, -1):
        legend = figure.legend(
            handles=entries,
            loc="lower left",
            bbox_to_anchor=(_LEFT, bottom),
            bbox_transform=figure.dpi_scale_trans,
            ncols=columns,
            **_LEGEND,
        )
        box = legend.get_window_extent()
        if box.width <= room or columns == 1:
            return box.height / figure.dpi + 0.08
        legend.remove()
    return 0.0


def _write_words(figure: "Figure", words: tuple[str, str], lines: list[str]) -> None:
    """Title and subtitle above, notes below."""
    width, height = figure.get_size_inches().tolist()
    look = {"transform": figure.dpi_scale_trans, "va": "baseline"}
    for word, size, drop, weight in ((words[0], _TITLE, 0.42, "bold"), (words[1], _SUBTITLE, 0.7, "normal")):
        text = figure.text(_LEFT, height - drop, word, fontsize=size, fontweight=weight, **look)
        shrink(text, (width - _LEFT - _EDGE) * figure.dpi)
    for k, line in enumerate(reversed(lines)):
        figure.text(_LEFT, _EDGE + k * _LINE, line, fontsize=TEXT - 1, color="0.25", **look)


def _add_north(figure: "Figure", left: float, free: tuple[float, float]) -> tuple[float, float]:
    """An arrow at the upper end of a strip; returns what is left of it [in]."""
    top = free[1]
    look = {"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "linewidth": 1.6, "color": "black"}
    axes = figure.add_axes(_share(figure, (left, top - _ARROW, 0.3, _ARROW)))
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.annotate("", (0.5, 0.72), xytext=(0.5, 0.0), arrowprops=look)
    axes.text(0.5, 0.74, "N", ha="center", va="bottom", fontsize=TEXT, fontweight="bold")
    return free[0], top - _ARROW - 0.2


def _add_scale_bar(figure: "Figure", scale: float, left: float, free: tuple[float, float]) -> tuple[float, float]:
    """A length in meters at the lower end of a strip; returns what is left of it [in]."""
    longest = (_RIGHT - 0.15 - _EDGE) / scale  # [m]
    step = 10.0 ** np.floor(np.log10(longest))
    length = float(step * max(n for n in (1, 2, 5) if n * step <= longest))
    axes = figure.add_axes(_share(figure, (left, free[0], length * scale, 0.07)))
    axes.set(xlim=(0, 2), ylim=(0, 1), xticks=(), yticks=())
    axes.axvspan(0, 1, color="black", linewidth=0)
    axes.text(1, 1.6, f"{length:g} m", ha="center", va="bottom", fontsize=TEXT)
    return free[0] + _BAR, free[1]
