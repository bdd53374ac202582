"""Shifts as the paper draws them: estimated against true, rotation at the left, translation at the right."""

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from tools.atomic import atomic_path
from tools.reproduce.experiment import Row
from tools.reproduce.voxel_series import ROTATION, TRANSLATION, picked

_COLORS = ("tab:blue", "tab:orange", "tab:green")
_WRONG = "0.88"

# File name -> caption, and the noises in it
PICTURES: MappingProxyType[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "translation-D0.png": ("Without noise, as Fig. 12", ("D0",)),
        "translation-100.png": ("Swap ratio 1/100, as Fig. 14", ("D1", "D3", "D5")),
        "translation-25.png": ("Swap ratio 1/25, as Fig. 15", ("D2", "D4", "D6")),
    }
)


def draw_translation(path: Path, rows: Sequence[Row], noises: Sequence[str]) -> None:
    """Write a PNG: a line of axes per noise. Lines are true, crosses estimated; gray is wrong."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.9 * len(noises) + 0.3), dpi=90, layout="constrained")
    axes = figure.subplots(len(noises), 2, squeeze=False, sharex=True)
    for (left, right), noise in zip(axes, noises, strict=True):
        some = picked(rows, noise=noise)
        distance = np.array([row["distance_m"] for row in some])
        for one, names, unit in ((left, ROTATION, "deg"), (right, TRANSLATION, "m")):
            draw_series(one, distance, some, names, unit)
            one.set_title(f"{noise}: {'rotation' if unit == 'deg' else 'translation'}", fontsize=10)
        left.set_ylabel("estimated [degrees]")
        right.set_ylabel("estimated [m]")
        bound = max(5.0, *(1.1 * abs(float(row[f"found_{name}_deg"])) for row in some for name in ROTATION))
        left.set_ylim(-bound, bound)
    for one in axes[-1]:
        one.set_xlabel("true distance [m]")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def draw_series(axes: Any, place: np.ndarray, rows: Sequence[Row], names: Sequence[str], unit: str) -> None:
    """Three parameters over `place` (N,): a line of true values, a cross for each estimate, gray where wrong."""
    half = float(np.min(np.diff(place))) / 2 if len(place) > 1 else 1.0
    for x, row in zip(place, rows, strict=True):
        if not row["right"]:
            axes.axvspan(x - half, x + half, color=_WRONG, linewidth=0)
    for name, color in zip(names, _COLORS, strict=True):
        axes.plot(place, [row[f"true_{name}_{unit}"] for row in rows], color=color, linewidth=1.2)
        axes.plot(place, [row[f"found_{name}_{unit}"] for row in rows], "x", color=color, markersize=5, label=name)
    axes.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
    axes.grid(alpha=0.3)
