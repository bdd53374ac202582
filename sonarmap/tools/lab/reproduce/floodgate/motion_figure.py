"""Motion estimates (the paper's Fig. 31), and what they add up to along the chain."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.lab.reproduce.answer import PARAMETERS
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import new_figure
from sonarmap.tools.lab.reproduce.floodgate.chain import MAP_90
from sonarmap.tools.lab.reproduce.floodgate.methods import COMPARED, TRUTH, label
from sonarmap.tools.lab.reproduce.floodgate.tables import Chains, Run, runs_of, shown
from sonarmap.tools.products.report.small_png import save_small

if TYPE_CHECKING:
    from matplotlib.axes import Axes
_NAMES = ("x [m]", "y [m]", "z [m]", "yaw [degrees]", "roll [degrees]", "pitch [degrees]")
_LEAST_ROOM = 2.0  # above and below the true values [m or degrees]; what is farther off is shown at the rim
_COARSE = 128  # voxels per edge: open marks
_TRUE: dict[str, Any] = {"color": "black", "linewidth": 1.6}


def draw_motion(path: Path, chains: Chains, seed: int) -> None:
    """Write x, y, z, yaw, roll and pitch between consecutive scans of one survey: true lines, estimated marks."""
    figure = new_figure(15, 8.2, dpi=110)
    runs = {run: chains[seed, *run].pairs for run in shown(runs_of(chains))}
    pairs = next(iter(runs.values()))
    source = [int(row["scan"]) for row in pairs]
    panels = figure.subplots(2, 3, sharex=True).ravel()
    for axes, parameter, name in zip(panels, PARAMETERS, _NAMES, strict=True):
        true = _values(pairs, f"true_{parameter}")
        room = max(_LEAST_ROOM, float(np.ptp(true)) / 2)
        low, high = true.min() - room, true.max() + room
        axes.plot(source, true, "-", label="true", **_TRUE)
        for run, rows in runs.items():
            estimated = _values(rows, f"found_{parameter}").clip(low, high)
            axes.plot(source, estimated, linestyle="none", clip_on=False, zorder=3, **_style(run))
        axes.set(ylabel=name, ylim=(low, high))
        axes.grid(alpha=0.3)
        axes.set_xticks(source, [f"{k - 1}→{k}" for k in source], rotation=90, fontsize=8)
    _legend(figure, panels[-1])
    save_small(figure, path)


def draw_poses(path: Path, chains: Chains, seed: int) -> None:
    """Write how the error of the poses grows along the chain of one survey, by method, and the map's with it."""
    figure = new_figure(15, 4.8, dpi=110)
    panels = figure.subplots(1, 3)
    columns = {
        "translation_m": "error of the pose [m]",
        "rotation_deg": "error of the pose [degrees]",
        MAP_90: "90 % of the map so far within [m]",
    }
    for axes, (column, name) in zip(panels, columns.items(), strict=True):
        for run in runs_of(chains):
            values = chains[seed, *run].column(column)[1:]
            axes.plot(range(1, 1 + len(values)), values, linewidth=1.2, **_style(run))
        _logarithmic(axes, name)
    floor = chains[seed, TRUTH, 0].column(MAP_90)[1:]
    panels[-1].plot(range(1, 1 + len(floor)), floor, "-", label=TRUTH, **_TRUE)
    for axes in panels:
        axes.set_xticks(range(1, 1 + len(floor), 2))
    _legend(figure, panels[-1])
    save_small(figure, path)


def _values(rows: tuple[Row, ...], column: str) -> np.ndarray:
    return np.array([float(row[column]) for row in rows])


def _logarithmic(axes: "Axes", name: str) -> None:
    """Plain numbers at 1, 2 and 5 of every decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="scan", ylabel=name)
    axes.grid(alpha=0.3)


def _legend(figure: Any, axes: "Axes") -> None:
    lines, names = axes.get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower center", ncols=len(names), frameon=False)


def _style(run: Run) -> dict[str, Any]:
    """Every method in its color; on the coarser of the paper's grids with open marks."""
    method, edge = run
    shown_method, coarse = COMPARED[method], edge == _COARSE
    return {
        "color": shown_method.color,
        "marker": shown_method.mark,
        "markersize": 7 if coarse else 5,
        "markerfacecolor": "none" if coarse else shown_method.color,
        "label": label(*run),
    }
