"""The track upon a map: where it begins and ends, its direction, and which survey it is of."""

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.products.report.labels import place_labels
from sonarmap.tools.products.report.naming import plain_text
from sonarmap.tools.products.report.survey.view import PartView

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_Box = tuple[float, float, float, float]

# Of Okabe and Ito's colors those that differ from the map's own, to any eye; a white rim parts them from it.
_COLORS = ("#D55E00", "#000000", "#CC79A7", "#E69F00", "#56B4E9")
_STYLES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))  # where the colors repeat
_WIDTH, _RIM = 1.3, 1.4  # of the line, and of the rim on both sides together [pt]
_APART, _CLEAR = 0.9, 0.22  # arrows along the track, and least distance from another mark [in]
_ARROW = ((-0.5, -0.55), (0.6, 0.0), (-0.5, 0.55), (-0.25, 0.0), (-0.5, -0.55))  # to the right
_NUMBERS = 10  # scans whose numbers are written, at most
_LONGEST = 28  # name of a scan
_DENSE = 3.0  # points of the track that labels avoid [pixels apart]


def draw_track(axes: "Axes", view: PartView, places: np.ndarray, *, numbers: bool = True) -> None:
    """Draw the track of each survey through places (n, 2) in the picture [m], its start, end and direction, and the
    numbers of some scans. The figure's size, and the axes' place and limits, must be final."""
    taken: list[_Box] = []
    for k, leg in enumerate(view.legs().values()):
        axes.plot(*places[leg].T, linewidth=_WIDTH, zorder=5, path_effects=_rim(), **look_of(k))
        taken += _mark(axes, places[leg], look_of(k)["color"])
    if numbers and len(places) > 2:
        chosen = _numbered(axes, view, places)
        texts = [str(view.scans[k]) for k in chosen]
        look: dict[str, Any] = {"fontsize": 9, "fontweight": "bold", "zorder": 8, "path_effects": _rim(2.5)}
        place_labels(axes, places[chosen], texts, covered=_along(axes, places), taken=taken, **look)


def track_legend(view: PartView, *, numbers: bool = True) -> list["Artist"]:
    """What `draw_track` draws, for the legend."""
    from matplotlib.lines import Line2D

    legs = view.legs()
    entries: list[Artist] = []
    for k, (number, leg) in enumerate(legs.items()):
        name = "track of the sensor" if len(legs) == 1 else view.survey_names[number]
        entries.append(Line2D([], [], label=f"{name}, {counted(len(leg), 'scan')}", linewidth=1.8, **look_of(k)))
    color = look_of(0)["color"] if len(legs) == 1 else "0.3"
    for shape, end, name in (("o", "start", view.names[0]), ("s", "end", view.names[-1])):
        label = end if len(legs) > 1 else f"{end}: {plain_text(name, _LONGEST)}"
        entries.append(Line2D([], [], linestyle="none", label=label, **_marker(shape, color)))
    if numbers and len(view.scans) > 2:
        look: dict[str, Any] = {"marker": "$12$", "color": "black", "markersize": 13, "markeredgewidth": 0}
        entries.append(Line2D([], [], linestyle="none", label="number of a scan", **look))
    return entries


def look_of(k: int) -> dict[str, Any]:
    """Color and style of the track of the survey that is number `k` in a part."""
    return {"color": _COLORS[k % len(_COLORS)], "linestyle": _STYLES[k // len(_COLORS) % len(_STYLES)]}


def _numbered(axes: "Axes", view: PartView, places: np.ndarray) -> list[int]:
    """Scans whose numbers are written: each so many-th that is not where another is already."""
    dots, step = axes.transData.transform(places), number_step(len(places))
    chosen: list[int] = []
    for k in (k for k, scan in enumerate(view.scans) if scan % step == 0):
        if all(np.hypot(*(dots[k] - dots[other])) > _CLEAR * axes.figure.dpi for other in chosen):
            chosen.append(k)
    return chosen


def inks_of(view: PartView) -> list[str]:
    """The colors of a part's tracks."""
    return sorted({look_of(k)["color"] for k in range(len(view.legs()))})


def number_step(count: int) -> int:
    """A round number such that every so many-th of `count` scans can get its number."""
    steps = (step * 10**power for power in itertools.count() for step in (1, 2, 5))
    return next(step for step in steps if count <= step * _NUMBERS)


def _mark(axes: "Axes", places: np.ndarray, color: str) -> list[_Box]:
    """Start, end and arrows between them; returns their boxes [pixels]."""
    dots = axes.transData.transform(places)
    clear = _CLEAR * axes.figure.dpi
    kept = [dots[0], dots[-1]]
    for place, angle in _arrows(dots, _APART * axes.figure.dpi):
        if min(np.hypot(*(place - other)) for other in kept) > clear:
            kept.append(place)
            _draw_arrow(axes, place, angle, color)
    for shape, place in (("o", places[0]), ("s", places[-1])):
        axes.plot(*place, linestyle="none", zorder=7, **_marker(shape, color))
    half = clear / 3
    return [(x - half, y - half, x + half, y + half) for x, y in kept]


def _arrows(dots: np.ndarray, apart: float) -> list[tuple[np.ndarray, float]]:
    """Where arrows stand on a track (n, 2) [pixels], and where they point [rad]."""
    steps = np.diff(dots, axis=0)
    lengths = np.hypot(*steps.T)
    reached = np.concatenate([[0.0], np.cumsum(lengths)])
    count = int(reached[-1] / apart)
    chosen = (np.arange(max(1, count)) + 0.5) * reached[-1] / max(1, count)
    arrows = []
    for k, at in zip(np.searchsorted(reached, chosen, side="right") - 1, chosen, strict=True):
        if k < len(steps) and lengths[k] > 0:
            place = dots[k] + steps[k] * (at - reached[k]) / lengths[k]
            arrows.append((place, float(np.arctan2(steps[k, 1], steps[k, 0]))))
    return arrows


def _draw_arrow(axes: "Axes", dot: np.ndarray, angle: float, color: str) -> None:
    from matplotlib.path import Path

    c, s = np.cos(angle), np.sin(angle)
    outline = Path(np.array(_ARROW) @ np.array([[c, s], [-s, c]]))
    look = {"color": color, "markersize": 9, "markeredgecolor": "white", "markeredgewidth": 0.7}
    axes.plot(*axes.transData.inverted().transform(dot), linestyle="none", marker=outline, zorder=6, **look)


def _marker(shape: str, color: str) -> dict[str, Any]:
    size = 10.0 if shape == "o" else 5.5  # the end is seen within the start where both meet
    edge = {"markeredgecolor": color, "markeredgewidth": 1.8}
    return {"marker": shape, "markersize": size, "markerfacecolor": "white", **edge}


def _rim(width: float = _RIM) -> list[Any]:
    """A white line around a line or a text."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=_WIDTH + width, foreground="white")]


def _along(axes: "Axes", places: np.ndarray) -> np.ndarray:
    """(m, 2) points all along the track, so dense that no label falls between them."""
    dots = axes.transData.transform(places)
    counts = np.maximum(1, np.hypot(*np.diff(dots, axis=0).T) / _DENSE).astype(int)
    pieces = [np.linspace(a, b, count) for a, b, count in zip(places[:-1], places[1:], counts, strict=True)]
    return np.concatenate([*pieces, places[-1:]])
