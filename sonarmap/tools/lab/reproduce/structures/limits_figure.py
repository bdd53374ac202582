"""Correlation peaks that tilt broadens, and the errors of the estimates: as the paper's Figs. 7 to 9."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import new_figure, save_figure
from sonarmap.tools.lab.reproduce.rows import column, where

PEAKS, DEVIATIONS = "limits-peaks.png", "limits.png"
_SHOWN_DEG = 45.0  # of the tilt's correlation, either way
_JITTER = 0.6  # [degrees], so that dots of one tilt do not hide each other


@dataclass(frozen=True, slots=True)
class Peaks:
    """Both correlations under one tilt."""

    # tilt_deg, yaw_deg: true roll and pitch, true yaw of `row`; `image` is without yaw
    tilt_deg: float
    yaw_deg: float
    image: np.ndarray  # (N, N) correlation over pitch and -roll, zero in the middle
    image_bin_deg: float  # [degrees]
    row: np.ndarray  # (M,) correlation over yaw, from zero on
    row_bin_deg: float  # [degrees]


def draw_peaks(path: Path, peaks: Sequence[Peaks]) -> None:
    """Write a PNG: roll and pitch above (Fig. 7), yaw below (Fig. 8), a column per tilt."""
    figure = new_figure(3.1 * len(peaks), 5.6, dpi=90)
    axes = figure.subplots(2, len(peaks), squeeze=False, sharey="row", height_ratios=(3, 2))
    for k, peak in enumerate(peaks):
        upper, lower = axes[0, k], axes[1, k]
        half = peak.image_bin_deg * len(peak.image) / 2
        # axis 0 is pitch, axis 1 is -roll: shown with roll to the right and pitch upward
        upper.imshow(peak.image[:, ::-1], origin="lower", extent=(-half, half, -half, half), cmap="magma")
        upper.plot(peak.tilt_deg, peak.tilt_deg, "o", markersize=16, markerfacecolor="none", markeredgecolor="cyan")
        upper.set(xlim=(-_SHOWN_DEG, _SHOWN_DEG), ylim=(-_SHOWN_DEG, _SHOWN_DEG), xlabel="roll [degrees]")
        upper.set_title(f"roll = pitch = {peak.tilt_deg:g}°", fontsize=10)
        lower.plot(np.arange(len(peak.row)) * peak.row_bin_deg, peak.row, linewidth=0.8)
        lower.axvline(peak.yaw_deg, color="black", linestyle=":")
        lower.set(xlim=(0, 180), xlabel="yaw [degrees]")
    axes[0, 0].set_ylabel("pitch [degrees]")
    axes[1, 0].set_ylabel("standard deviations")
    save_figure(figure, path)


def draw_deviations(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG: a column per angle, a dot per registration, its color what was tilted."""
    figure = new_figure(12, 3.6, dpi=90)
    kinds = {"roll": "tab:orange", "pitch": "tab:green", "both": "tab:red", "none": "tab:blue"}
    titles = {"yaw": "yaw, from its highest peak", "roll": "roll, yaw given", "pitch": "pitch, yaw given"}
    for axes, (name, title) in zip(figure.subplots(1, 3), titles.items(), strict=True):
        for number, (kind, color) in enumerate(kinds.items()):
            some = where(rows, tilted=kind)
            tilt = column(some, "tilt_deg") + _JITTER * (number - 1)
            off = column(some, f"{name}_off_deg")
            axes.plot(tilt, off, ".", color=color, markersize=5, label=f"{kind} tilted", alpha=0.7)
        axes.set(title=title, xlabel="tilt [degrees]", ylabel="estimated - true [degrees]")
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8, frameon=False)
    save_figure(figure, path)
