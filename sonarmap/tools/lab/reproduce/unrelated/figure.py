"""What the methods report for pairs that share nothing."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.figure import DPI, style
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import save_figure
from sonarmap.tools.lab.reproduce.rows import where

_MARKS = {"psr": "peak-to-sidelobe ratio", "probability": "reported probability", "overlap": "estimated overlap"}


def draw_unrelated(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG: one panel for each mark, a column of points for each method that has it.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 4.2), dpi=DPI, layout="constrained")
    for axes, (key, label) in zip(figure.subplots(1, len(_MARKS)), _MARKS.items(), strict=True):
        rated = [row for row in rows if not math.isnan(float(row[key]))]
        methods = list(dict.fromkeys(str(row["method"]) for row in rated))
        for column, method in enumerate(methods):
            some = where(rated, method=method)
            beside = 0.3 * np.linspace(-1, 1, len(some))  # in the order of the pairs, so that all are seen
            for is_accepted, mark, size in ((False, ".", 3), (True, "x", 7)):
                held = [
                    (column + x, row[key])
                    for x, row in zip(beside, some, strict=True)
                    if row["accepted"] is is_accepted
                ]
                look = style(method) | {"linewidth": 0}
                axes.plot(*np.array(held, float).reshape(-1, 2).T, mark, markersize=size, **look)
        axes.set_xticks(range(len(methods)), methods, rotation=40, ha="right", fontsize=8)
        axes.set_title(label if methods else f"{label}: by no method", fontsize=10)
        axes.grid(alpha=0.3)
    save_figure(figure, path)
