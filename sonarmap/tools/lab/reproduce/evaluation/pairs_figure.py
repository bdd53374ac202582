"""Success against overlap, and how well covariances and probabilities predict errors and success."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from sonarmap.tools.lab.reproduce.calibration_tables import FREEDOM, calibration, reliability, shared
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import draw_rates, draw_reliability, legend_beside, new_figure, save_figure
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import right, where, wilson

OVERLAP, NEES, PROBABILITY = "pairs-overlap.png", "pairs-nees.png", "pairs-probability.png"
_TURNS = {"yaw": "any yaw, tilt up to 35°", "any": "any rotation"}
_TENTHS = tuple(k / 10 for k in range(11))
_FARTHEST = 30.0  # normalized squared errors beyond it stand in the last bar


def draw_pairs(folder: Path, rows: Sequence[Row], methods: Sequence[str]) -> None:
    """Write the PNGs."""
    draw_overlap(folder / OVERLAP, rows, methods)
    if OURS in methods:
        draw_nees(folder / NEES, right(where(rows, method=OURS)))
        draw_probability(folder / PROBABILITY, where(rows, method=OURS))


def draw_overlap(path: Path, rows: Sequence[Row], methods: Sequence[str]) -> None:
    """The share of right registrations against the overlap of the scans."""
    figure = new_figure(10.6, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (turn, words) in zip(panels, _TURNS.items(), strict=True):
        for method in methods:
            some = where(rows, turn=turn, method=method)
            tenths = [pairs for low, high in pairwise(_TENTHS) if (pairs := shared(some, low, high))]
            places = [float(np.mean([float(row["shared"]) for row in pairs])) for pairs in tenths]
            draw_rates(axes, places, [wilson(len(right(pairs)), len(pairs)) for pairs in tenths], method)
        axes.set(title=words, xlabel="share of the points in common", xlim=(0, 1), ylim=(-0.03, 1.03))
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of pairs that are right")
    legend_beside(panels[-1])
    save_figure(figure, path)


def draw_nees(path: Path, rows: Sequence[Row]) -> None:
    """The normalized squared errors of right registrations, and the chi-squared density."""
    figure = new_figure(6.4, 3.8)
    axes = figure.subplots()
    nees = [float(row["nees"]) for row in rows if not math.isnan(float(row["nees"]))]
    calibrated = calibration(rows)
    bars = np.linspace(0, _FARTHEST, 31).tolist()
    if calibrated is not None:
        axes.hist(np.clip(nees, 0, _FARTHEST), bins=bars, density=True, color="C0", alpha=0.5, label=OURS)
        axes.axvline(calibrated.mean, color="C0", linewidth=1.5, label=f"its mean, {calibrated.mean:.2f}")
    x = np.linspace(0, _FARTHEST, 301)
    axes.plot(x, chi2.pdf(x, FREEDOM), "k-", linewidth=1.2, label=f"chi-squared({FREEDOM})")
    axes.set(xlabel=f"normalized squared error; all above {_FARTHEST:g} in the last bar", ylabel="density")
    axes.legend(fontsize=8, frameon=False)
    save_figure(figure, path)


def draw_probability(path: Path, rows: Sequence[Row]) -> None:
    """The share of right registrations against the reported probability."""
    figure = new_figure(4.6, 4.4)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], "k--", linewidth=0.9, label="calibrated")
    bins = reliability(rows)
    if bins:
        draw_reliability(axes, [(rated.predicted, rated.right) for rated in bins], (5, -9), 7)
    else:
        axes.set_title(f"{OURS} reports no probability", fontsize=10)
    axes.set(
        xlabel="reported probability (mean of a bin)", ylabel="share that is right", xlim=(0, 1), ylim=(-0.03, 1.03)
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, frameon=False)
    save_figure(figure, path)
