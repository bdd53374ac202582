"""Table 1 as pictures: the paper's Figs. 20 and 21, and the success rates over S0..S9."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.figure import draw_parameters, legend_beside, new_figure, save_figure
from sonarmap.tools.lab.reproduce.gaussian.row import GaussianRow
from sonarmap.tools.lab.reproduce.rows import wilson

TRANSLATION, ROTATION = ("x", "y", "z"), ("yaw", "roll", "pitch")
_MARKS = ("o-", "s--", "^:", "d-.")


def draw_table1(path: Path, rows: Sequence[GaussianRow]) -> None:
    """Write a PNG of one grid and seed: one column per method, two rows of axes per noise."""
    methods, noises = _methods(rows), _noises(rows)
    lines = 2 * len(noises)
    figure = new_figure(4.2 * len(methods), 2.5 * lines + 0.8)
    axes = figure.subplots(lines, len(methods), squeeze=False, sharex=True, sharey="row")
    for line, sigma2 in enumerate(noises):
        for column, method in enumerate(methods):
            mine = [row for row in rows if (row.sigma2, row.method) == (sigma2, method)]
            upper, lower = axes[2 * line, column], axes[2 * line + 1, column]
            places, right = np.array([row.scan for row in mine]), [row.right for row in mine]
            true, found = np.array([row.true for row in mine]).T, np.array([row.found for row in mine]).T
            for panel, names, first in ((upper, TRANSLATION, 0), (lower, ROTATION, 3)):
                series = {name: (true[first + k], found[first + k]) for k, name in enumerate(names)}
                draw_parameters(panel, places, right, series)  # pyright: ignore[reportArgumentType]
                panel.set_xlim(min(places) - 0.5, max(places) + 0.5)
            upper.set_title(f"{method}, σ² = {sigma2:g} m²", fontsize=11)
        axes[2 * line, 0].set_ylabel("translation [m]")
        axes[2 * line + 1, 0].set_ylabel("rotation [degrees]")
        for axis in axes[2 * line : 2 * line + 2, -1]:
            legend_beside(axis)
    _name_scans(axes[-1], rows)
    row = rows[0]
    figure.suptitle(
        f"Table 1 on {row.scene}, {row.grid}³ voxels of {row.voxel_m:g} m, seed {row.seed}: "
        "lines true, crosses estimated, gray wrong"
    )
    save_figure(figure, path)


def draw_rates(path: Path, rows: Sequence[GaussianRow]) -> None:
    """Write a PNG of the success rates over the scans: axes per noise, a color per method, a mark per grid."""
    noises = _noises(rows)
    figure = new_figure(4.6 * len(noises) + 2.2, 3.6)
    axes = figure.subplots(1, len(noises), squeeze=False, sharey=True)[0]
    for axis, sigma2 in zip(axes, noises, strict=True):
        _draw_rates(axis, [row for row in rows if row.sigma2 == sigma2])
        axis.set_title(f"σ² = {sigma2:g} m²", fontsize=11)
    axes[0].set_ylabel("share of seeds that are right")
    legend_beside(axes[-1])
    _name_scans(axes, rows)
    save_figure(figure, path)


def _draw_rates(axes: Any, rows: Sequence[GaussianRow]) -> None:
    """A line with intervals for each grid and method, a little beside each other."""
    methods, scans = _methods(rows), sorted({row.scan for row in rows})
    lines = [(grid, method) for grid in dict.fromkeys(row.grid for row in rows) for method in methods]
    grids = list(dict.fromkeys(grid for grid, _ in lines))
    for k, (grid, method) in enumerate(lines):
        mine = [row for row in rows if (row.grid, row.method) == (grid, method)]
        counts = [[row.right for row in mine if row.scan == scan] for scan in scans]
        rates = [wilson(sum(right), len(right)) for right in counts]
        share = np.array([rate.successes / rate.trials for rate in rates])
        bounds = np.abs(np.array([[rate.low for rate in rates], [rate.high for rate in rates]]) - share)
        axes.errorbar(
            np.array(scans) + 0.1 * (k - (len(lines) - 1) / 2),
            share,
            yerr=bounds,
            fmt=_MARKS[grids.index(grid) % len(_MARKS)],
            color=f"C{methods.index(method)}",
            markersize=4,
            linewidth=1.1,
            elinewidth=0.6,
            label=f"{grid}³, {method}",
        )
    axes.set_ylim(-0.05, 1.05)
    axes.grid(alpha=0.3)


def _name_scans(axes: Any, rows: Sequence[GaussianRow]) -> None:
    scans = sorted({row.scan for row in rows})
    for axis in axes:
        axis.set_xticks(scans, [f"S{scan}" for scan in scans])


def _methods(rows: Sequence[GaussianRow]) -> list[str]:
    return list(dict.fromkeys(row.method for row in rows))


def _noises(rows: Sequence[GaussianRow]) -> list[float]:
    return list(dict.fromkeys(row.sigma2 for row in rows))
