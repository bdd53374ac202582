"""Table 1 as pictures: the paper's Figs. 20 and 21, and the success rates over S0..S9."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import draw_parameters, legend_beside, new_figure, save_figure
from sonarmap.tools.lab.reproduce.gaussian.section import RATES, parameters_picture
from sonarmap.tools.lab.reproduce.rows import column, distinct, grouped, right, where, wilson

_PANELS = (("x_m", "y_m", "z_m"), ("yaw_deg", "roll_deg", "pitch_deg"))
_MARKS = ("o-", "s--", "^:", "d-.")


def draw_gaussian(folder: Path, rows: Sequence[Row], settings: Any) -> None:
    """Write one PNG per grid after Figs. 20 and 21, and one of the rates; `settings` are GaussianSettings."""
    for edge in settings.edges:
        draw_table1(folder / parameters_picture(edge), where(rows, grid=edge, seed=settings.first_seed))
    draw_rates(folder / RATES, rows)


def draw_table1(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG of one grid and seed: one column per method, two rows of axes per noise."""
    methods, noises = distinct(rows, "method"), grouped(rows, "sigma2")
    figure = new_figure(4.2 * len(methods), 5.0 * len(noises) + 0.8)
    axes = figure.subplots(2 * len(noises), len(methods), squeeze=False, sharex=True, sharey="row")
    for line, ((sigma2,), some) in enumerate(noises.items()):
        for number, method in enumerate(methods):
            mine = where(some, method=method)
            places, are_right = column(mine, "scan").astype(int), [bool(row["right"]) for row in mine]
            panels = axes[2 * line : 2 * line + 2, number]
            for panel, names in zip(panels, _PANELS, strict=True):
                series = {n.split("_")[0]: (column(mine, f"true_{n}"), column(mine, f"found_{n}")) for n in names}
                draw_parameters(panel, places, are_right, series)  # pyright: ignore[reportArgumentType]
                panel.set_xlim(min(places) - 0.5, max(places) + 0.5)
            panels[0].set_title(f"{method}, σ² = {sigma2:g} m²", fontsize=11)
        axes[2 * line, 0].set_ylabel("translation [m]")
        axes[2 * line + 1, 0].set_ylabel("rotation [degrees]")
        for axis in axes[2 * line : 2 * line + 2, -1]:
            legend_beside(axis)
    _name_scans(axes[-1], rows)
    row = rows[0]
    figure.suptitle(
        f"Table 1 on {row['scene']}, {row['grid']}³ voxels of {row['voxel_m']:g} m, seed {row['seed']}: "
        "lines true, crosses estimated, gray wrong"
    )
    save_figure(figure, path)


def draw_rates(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG of the success rates over the scans: axes per noise, a color per method, a mark per grid."""
    noises = grouped(rows, "sigma2")
    figure = new_figure(4.6 * len(noises) + 2.2, 3.6)
    axes = figure.subplots(1, len(noises), squeeze=False, sharey=True)[0]
    for axis, ((sigma2,), some) in zip(axes, noises.items(), strict=True):
        _draw_rates(axis, some)
        axis.set_title(f"σ² = {sigma2:g} m²", fontsize=11)
    axes[0].set_ylabel("share of seeds that are right")
    legend_beside(axes[-1])
    _name_scans(axes, rows)
    save_figure(figure, path)


def _draw_rates(axes: Any, rows: Sequence[Row]) -> None:
    """A line with intervals for each grid and method, a little beside each other."""
    methods, grids = distinct(rows, "method"), distinct(rows, "grid")
    scans = _scans(rows)
    for k, (grid, method) in enumerate(lines := [(grid, method) for grid in grids for method in methods]):
        mine = [row for row in where(rows, method=method) if str(row["grid"]) == grid]
        counts = [where(mine, scan=scan) for scan in scans]
        rates = [wilson(len(right(trials)), len(trials)) for trials in counts]
        share = np.array([rate.share for rate in rates])
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


def _name_scans(axes: Any, rows: Sequence[Row]) -> None:
    scans = _scans(rows)
    for axis in axes:
        axis.set_xticks(scans, [f"S{scan}" for scan in scans])


def _scans(rows: Sequence[Row]) -> list[int]:
    return sorted({int(row["scan"]) for row in rows})
