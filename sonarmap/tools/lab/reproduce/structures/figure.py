"""Moved structures as the paper draws them: estimated and true parameters, a line of axes per noise."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import save_figure
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.structures.voxel_series import ROTATION, TRANSLATION

_COLORS = ("tab:blue", "tab:orange", "tab:green")
_WRONG = "0.88"
_LEAST_SPAN = 10.0  # of the vertical axes [degrees, m], so that what is right looks flat


def draw_series(path: Path, rows: Sequence[Row], noises: Sequence[str], over: str, label: str) -> None:
    """Write a PNG: rotation at the left, translation at the right. Lines are true, crosses estimated; gray is wrong.

    Args:
        rows: of one structure.
        noises: one line of axes each.
        over, label: the column along the horizontal axis, and what to call it.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.8 * len(noises) + 0.3), dpi=90, layout="constrained")
    axes = figure.subplots(len(noises), 2, squeeze=False, sharex=True)
    for (left, right), noise in zip(axes, noises, strict=True):
        some = where(rows, noise=noise)
        _draw(left, some, over, ROTATION, "deg")
        _draw(right, some, over, TRANSLATION, "m")
        left.set(title=f"{noise}: rotation", ylabel="estimated [degrees]")
        right.set(title=f"{noise}: translation", ylabel="estimated [m]")
    for panel in axes[-1]:
        panel.set_xlabel(label)
    save_figure(figure, path)


def _draw(axes: Any, rows: Sequence[Row], over: str, names: Sequence[str], unit: str) -> None:
    """Three parameters: a line of true values, a cross for each estimate."""
    place = np.array([float(row[over]) for row in rows])
    half = float(np.min(np.diff(place))) / 2 if len(place) > 1 else 1.0
    for x, row in zip(place, rows, strict=True):
        if not row["right"]:
            axes.axvspan(x - half, x + half, color=_WRONG, linewidth=0)
    for name, color in zip(names, _COLORS, strict=True):
        axes.plot(place, [row[f"true_{name}_{unit}"] for row in rows], color=color, linewidth=1.2)
        axes.plot(place, [row[f"found_{name}_{unit}"] for row in rows], "x", color=color, markersize=5, label=name)
    low, high = axes.get_ylim()
    if high - low < _LEAST_SPAN:
        axes.set_ylim((low + high - _LEAST_SPAN) / 2, (low + high + _LEAST_SPAN) / 2)
    axes.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
    axes.grid(alpha=0.3)
