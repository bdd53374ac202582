"""Right and believed by set and method, and how large the errors are."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.evaluation.figure import DPI, style
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import accepted, refused, right, wrong
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import save_figure
from sonarmap.tools.lab.reproduce.real.settings import RealSettings
from sonarmap.tools.lab.reproduce.real.tables import variants
from sonarmap.tools.lab.reproduce.rows import where

OUTCOMES, ERRORS = "real.png", "real-errors.png"
_KINDS = (
    ("right, believed", "#2a7f3f", lambda rows: accepted(right(rows))),
    ("right, not believed", "#a9d6b0", lambda rows: refused(right(rows))),
    ("wrong, not believed", "#dddddd", lambda rows: refused(wrong(rows))),
    ("wrong, believed", "#c0392b", lambda rows: accepted(wrong(rows))),
)
_LEAST_DEG, _LEAST_VOXELS = 0.01, 0.01  # smaller errors are drawn there


def draw_real(folder: Path, rows: Sequence[Row], settings: RealSettings) -> None:
    """Write the PNGs.

    Raises:
        InputError: a file cannot be written.
    """
    draw_outcomes(folder / OUTCOMES, rows, list(settings.sets))
    draw_errors(folder / ERRORS, rows, settings.compared.methods)


def draw_outcomes(path: Path, rows: Sequence[Row], sets: Sequence[str]) -> None:
    """A panel for every set, a bar for every method."""
    from matplotlib.figure import Figure

    bars = variants(rows)
    figure = Figure(figsize=(2.6 * len(sets) + 3.4, 0.32 * len(bars) + 1.4), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, len(sets), squeeze=False, sharey=True)[0]
    places = np.arange(len(bars))
    for axes, name in zip(panels, sets, strict=True):
        of_bars = [where(rows, set=name, method=method, known=known) for method, known in bars]
        left = np.zeros(len(bars))
        for label, color, choose in _KINDS:
            shares = np.array([len(choose(some)) / max(len(some), 1) for some in of_bars])
            axes.barh(places, shares, left=left, color=color, label=label, height=0.75)
            left += shares
        axes.set(title=name, xlabel="share of registrations", xlim=(0, 1))
    labels = [method if known == "nothing" else f"{method}, {known} known" for method, known in bars]
    panels[0].set_yticks(places, labels, fontsize=8)
    panels[0].invert_yaxis()
    panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    save_figure(figure, path)


def draw_errors(path: Path, rows: Sequence[Row], methods: Sequence[str]) -> None:
    """Rotation against translation of every registration, both on a logarithmic scale."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.6), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    for method in methods:
        some = where(rows, method=method)
        _scatter(axes, accepted(some), method, filled=True)
        _scatter(axes, refused(some), method, filled=False)
    axes.axhline(RIGHT_DEG, color="k", linewidth=0.8, linestyle="--")
    axes.axvline(RIGHT_VOXELS, color="k", linewidth=0.8, linestyle="--")
    axes.set(xscale="log", yscale="log", xlabel="translation error [voxels]", ylabel="rotation error [degrees]")
    axes.set_title("filled: believed", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    save_figure(figure, path)


def _scatter(axes: Any, rows: Sequence[Row], method: str, filled: bool) -> None:
    look = style(method)
    x = np.maximum([float(row["translation_voxels"]) for row in rows], _LEAST_VOXELS)
    y = np.maximum([float(row["rotation_deg"]) for row in rows], _LEAST_DEG)
    axes.scatter(
        x,
        y,
        s=46 if method == OURS else 20,
        facecolors=look["color"] if filled else "none",
        edgecolors=look["color"],
        zorder=look["zorder"],
        label=method if filled else None,
    )
