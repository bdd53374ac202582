"""Right and believed by kind of scan, and the reliability of the probability in every kind."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.reproduce.calibration_tables import reliability
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import draw_bars, draw_reliability, new_figure, save_figure
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import TENTHS, expected_error
from sonarmap.tools.lab.reproduce.kinds.tables import (
    every_variant,
    tried,
    variant_words,
    without_navigation,
    worst_first,
)
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import where

OUTCOMES, RELIABILITY = "kinds.png", "kinds-probability.png"
_IN_A_ROW = 4


def draw_kinds(folder: Path, rows: Sequence[Row]) -> None:
    """Write the PNGs; the second only where ours ran."""
    draw_outcomes(folder / OUTCOMES, rows)
    if ours := without_navigation(where(rows, method=OURS)):
        draw_probability(folder / RELIABILITY, ours)


def draw_outcomes(path: Path, rows: Sequence[Row]) -> None:
    """A panel for every method and what it is given, a bar for every kind, the worst on top."""
    kinds, columns = worst_first(rows), every_variant(rows)
    lines = -(-len(columns) // _IN_A_ROW)
    across = min(len(columns), _IN_A_ROW)
    size = (2.5 * across + 1.2, lines * (0.26 * len(kinds) + 0.8) + 0.5)
    figure = new_figure(*size)
    panels = figure.subplots(lines, across, squeeze=False, sharey=True, sharex=True).ravel()
    places = np.arange(len(kinds))
    for axes, (method, known) in zip(panels, columns, strict=False):
        bars = [where(tried(rows), kind=kind, method=method, priors=known) for kind in kinds]
        draw_bars(axes, bars)
        axes.set_title(variant_words(method, known).replace(", known", ",\nknown"), fontsize=9)
        axes.set_xlim(0, 1)
        axes.tick_params(labelsize=8)
    panels[0].set_yticks(places, kinds)
    panels[0].invert_yaxis()
    for axes in panels[len(columns) :]:
        axes.set_axis_off()
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False
    )
    save_figure(figure, path)


def draw_probability(path: Path, rows: Sequence[Row]) -> None:
    """A panel for every kind: the share right against the reported probability, in ten bins."""
    kinds = worst_first(rows)
    lines, across = -(-len(kinds) // _IN_A_ROW), min(len(kinds), _IN_A_ROW)
    figure = new_figure(2.6 * across + 0.4, 2.7 * lines + 0.2)
    panels = figure.subplots(lines, across, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, kind in zip(panels, kinds, strict=False):
        some = where(rows, kind=kind)
        bins = reliability(some, TENTHS)
        axes.plot([0, 1], [0, 1], "k--", linewidth=0.8)
        draw_reliability(axes, [(rated.predicted, rated.right) for rated in bins], (4, -9), 6)
        axes.set_title(f"{kind}: {expected_error(some):.3f}", fontsize=9)
        axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
        axes.grid(alpha=0.3)
    for axes in panels[len(kinds) :]:
        axes.set_axis_off()
    figure.supxlabel("reported probability (mean of a bin)", fontsize=9)
    figure.supylabel("share that is right", fontsize=9)
    save_figure(figure, path)
