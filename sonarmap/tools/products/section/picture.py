"""A section as a picture: distance along the line against height, colored by the points' sigmas. One PNG."""

import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.products.report.small_png import shrink, write_png
from sonarmap.tools.products.section.section import Profile, Section

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from matplotlib.figure import Figure

_WIDTH, _DPI = 11.7, 140  # [in], of A4 landscape
_PANEL, _LOWEST, _HIGHEST = 9.2, 2.4, 6.4  # of the panel [in]: its width, and between which heights it has
_LEFT, _BELOW, _ABOVE = 1.0, 0.65, 0.95  # beside the panel [in]
_TEXT, _TITLE = 10.0, 15.0  # [pt]
_LINE_LENGTH = 30  # characters of the vertical axis' name
_COLORS, _LINE = "viridis", "#D55E00"
_SURE = (0.02, 0.98)  # quantiles of the sigmas between which the colors change
_BROKEN = 2.5  # cells between two medians from which on they are not joined


@dataclass(frozen=True, slots=True)
class Titles:
    """What a picture says of its section."""

    title: str
    below: str
    height: str  # the name of its vertical axis, without the unit
    exaggeration: float = 1.0  # of heights
    cell: float = 1.0  # of the profile [m]


def draw_section(path: Path, section: Section, profile: Profile, titles: Titles) -> None:
    """Write a PNG of a section. The same section gives the same bytes.

    Raises InputError: the file cannot be written."""
    from matplotlib import colormaps

    ramp = colormaps[_COLORS](np.linspace(0, 1, 256))[:, :3]
    write_png(lambda: section_figure(section, profile, titles), path, (_LINE,), ramp)


def section_figure(section: Section, profile: Profile, titles: Titles) -> "Figure":
    """The figure: a meter is as long upward as along the line, times the exaggeration."""
    from matplotlib.figure import Figure

    length, span = section.length, float(np.ptp(section.height))
    panel = float(np.clip(_PANEL * 1.15 * span * titles.exaggeration / length, _LOWEST, _HIGHEST))
    height = panel + _BELOW + _ABOVE
    figure = Figure(figsize=(_WIDTH, height), dpi=_DPI)
    axes = figure.add_axes((_LEFT / _WIDTH, _BELOW / height, _PANEL / _WIDTH, panel / height))
    dots = _draw_points(axes, section)
    _draw_profile(axes, profile, titles)
    # limits of one scale: the panel's shape is what it is, so what is too short gets room
    upward = max(1.15 * span, length * panel / _PANEL / titles.exaggeration)
    along = max(length, upward * titles.exaggeration * _PANEL / panel)
    middle = float(section.height.min() + section.height.max()) / 2
    axes.set_xlim(length / 2 - along / 2, length / 2 + along / 2)
    axes.set_ylim(middle - upward / 2, middle + upward / 2)
    axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
    axes.tick_params(labelsize=_TEXT)
    axes.set_xlabel("distance along the line [m]", fontsize=_TEXT)
    axes.set_ylabel(textwrap.fill(f"{titles.height} [m]", _LINE_LENGTH), fontsize=_TEXT)
    axes.legend(loc="upper right", fontsize=_TEXT - 1, framealpha=0.85, edgecolor="none")
    bar = figure.colorbar(
        dots, cax=figure.add_axes(((_LEFT + _PANEL + 0.2) / _WIDTH, _BELOW / height, 0.018, panel / height))
    )
    bar.set_label("sigma of the points [m]", fontsize=_TEXT)
    for up, words, points, weight in ((0.42, titles.title, _TITLE, "bold"), (0.72, titles.below, _TEXT, "normal")):
        text = figure.text(_LEFT / _WIDTH, 1 - up / height, words, fontsize=points, weight=weight)
        shrink(text, (_WIDTH - _LEFT - 0.3) * _DPI)
    return figure


def _draw_points(axes: "Axes", section: Section) -> "PathCollection":
    """The points, the surest on top."""
    order = np.argsort(-section.sigma, kind="stable")
    least, most = np.quantile(section.sigma, _SURE).tolist()
    size = float(np.clip(4000 / np.sqrt(len(order)) / 6, 3, 26))
    dots = axes.scatter(
        section.distance[order], section.height[order], size, section.sigma[order], cmap=_COLORS, vmin=least, vmax=most
    )
    dots.set(edgecolor="none", rasterized=True)
    return dots


def _draw_profile(axes: "Axes", profile: Profile, titles: Titles) -> None:
    """The medians, joined where no cell between them is empty for long."""
    gaps = np.flatnonzero(np.diff(profile.distance) > _BROKEN * titles.cell) + 1
    axes.plot(
        np.insert(profile.distance, gaps, np.nan),
        np.insert(profile.height, gaps, np.nan),
        ".-",
        markersize=3,
        color=_LINE,
        linewidth=1.2,
        label=f"median of every {titles.cell:.3g} m",
    )
