"""What the figures of several experiments share: writing them, a color per method, curves of rates, series, shares."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.methods import EVALUATED, OURS
from sonarmap.tools.lab.reproduce.rows import Rate, accepted, column, refused, right, where, wrong

_PANELS = (("rotation", ("yaw", "roll", "pitch"), "deg"), ("translation", ("x", "y", "z"), "m"))
_LEAST_SPAN = 10.0  # of vertical axes [degrees, m], so that what is right looks flat
WRONG = "0.88"  # the gray behind wrong registrations
OUTCOMES = (
    ("right, believed", "#2a7f3f", lambda rows: accepted(right(rows))),
    ("right, not believed", "#a9d6b0", lambda rows: refused(right(rows))),
    ("wrong, not believed", "#dddddd", lambda rows: refused(wrong(rows))),
    ("wrong, believed", "#c0392b", lambda rows: accepted(wrong(rows))),
)


def new_figure(width: float, height: float, dpi: int = 100) -> Any:
    """An empty matplotlib figure [inches] that makes room for all that is drawn."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def new_panels(
    count: int, across: int, size: tuple[float, float], margin: tuple[float, float], dpi: int = 100, **shared: bool
) -> tuple[Any, Any]:
    """A figure of `count` panels of a size, up to so many in a line, with a margin [inches]; and the panels."""
    columns = min(count, across)
    lines = -(-count // columns)
    figure = new_figure(size[0] * columns + margin[0], size[1] * lines + margin[1], dpi)
    panels = figure.subplots(lines, columns, squeeze=False, **shared).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure, panels


def save_figure(figure: Any, path: Path) -> None:
    """Write a matplotlib figure as PNG."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def legend_beside(axes: Any) -> None:
    """The legend at the right of the axes."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)


def legend_below(figure: Any, axes: Any) -> None:
    """The legend of the axes in one line below the whole figure."""
    lines, names = axes.get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower center", ncols=len(names), frameon=False)


def style(method: str) -> dict[str, Any]:
    """Ours stands out; each method looks the same in every figure."""
    color = f"C{EVALUATED.index(method)}" if method in EVALUATED else "k"
    return {"color": color, "linewidth": 2.2 if method == OURS else 1.1, "zorder": 3 if method == OURS else 2}


def draw_rates(axes: Any, places: Sequence[float], rates: Sequence[Rate], method: str) -> None:
    """A curve of rates over the places; ours with the band of their intervals."""
    appearance = style(method)
    axes.plot(places, [rate.share for rate in rates], "o-", markersize=4, label=method, **appearance)
    if method == OURS:
        low, high = [rate.low for rate in rates], [rate.high for rate in rates]
        axes.fill_between(places, low, high, color=appearance["color"], alpha=0.22, linewidth=0)


def draw_reliability(axes: Any, bins: Sequence[tuple[float, Rate]], offset: tuple[int, int], size: int) -> None:
    """The share right against the reported probability, with the counts; `bins` have each one's mean probability."""
    draw_rates(axes, [predicted for predicted, _ in bins], [rate for _, rate in bins], OURS)
    for predicted, rate in bins:
        place = (predicted, rate.share)
        axes.annotate(str(rate.trials), place, offset, textcoords="offset points", fontsize=size)


def draw_bars(axes: Any, bars: Sequence[Sequence[Row]]) -> None:
    """A bar for each group of rows: shares right and wrong, believed or not."""
    places, left = np.arange(len(bars)), np.zeros(len(bars))
    for label, color, choose in OUTCOMES:
        shares = np.array([len(choose(rows)) / max(len(rows), 1) for rows in bars])
        axes.barh(places, shares, left=left, color=color, label=label, height=0.75)
        left += shares


def draw_parameters(
    axes: Any,
    places: np.ndarray,
    right: Sequence[bool],
    series: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    half: float = 0.5,
) -> None:
    """Parameters of N registrations at places along the horizontal axis: a line of true values, a cross for each
    estimate (`series`: name -> N true values, N estimates), gray, twice `half` wide, behind those not `right`."""
    for place, is_right in zip(places, right, strict=True):
        if not is_right:
            axes.axvspan(place - half, place + half, color=WRONG, linewidth=0)
    for (name, (true, estimated)), color in zip(series.items(), ("tab:blue", "tab:orange", "tab:green"), strict=True):
        axes.plot(places, true, "-", color=color, linewidth=1.2)
        axes.plot(places, estimated, "x", color=color, markersize=5.5, markeredgewidth=1.4, label=name)
    axes.grid(alpha=0.3)


def draw_series(path: Path, rows: Sequence[Row], noises: Sequence[str], over: str, label: str) -> None:
    """Write a PNG of one structure: rotation at the left, translation at the right, a line of axes for each noise.

    Lines are true, crosses estimated; gray is wrong. `over` is the column along the horizontal axis, `label` its name.
    """
    figure = new_figure(10, 2.8 * len(noises) + 0.3, dpi=90)
    axes = figure.subplots(len(noises), 2, squeeze=False, sharex=True)
    for line, noise in zip(axes, noises, strict=True):
        some = where(rows, noise=noise)
        places = column(some, over)
        half = float(np.min(np.diff(places))) / 2 if len(places) > 1 else 1.0
        for panel, (what, names, unit) in zip(line, _PANELS, strict=True):
            series = {n: (column(some, f"true_{n}_{unit}"), column(some, f"found_{n}_{unit}")) for n in names}
            draw_parameters(panel, places, [bool(row["right"]) for row in some], series, half)  # pyright: ignore
            low, high = panel.get_ylim()
            if high - low < _LEAST_SPAN:
                panel.set_ylim((low + high - _LEAST_SPAN) / 2, (low + high + _LEAST_SPAN) / 2)
            panel.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
            panel.set(title=f"{noise}: {what}", ylabel=f"estimated [{'degrees' if unit == 'deg' else unit}]")
    for panel in axes[-1]:
        panel.set_xlabel(label)
    save_figure(figure, path)
