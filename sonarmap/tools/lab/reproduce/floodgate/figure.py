"""The maps from above over the true plan (the paper's Figs. 25, 28, 30), motion estimates (Fig. 31), and the scans."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.reproduce.answer import PARAMETERS
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import legend_below, new_figure, new_panels
from sonarmap.tools.lab.reproduce.floodgate.chain import (
    COMPARED,
    MAP_90,
    PAIR,
    POSE,
    TRUTH,
    FloodgateSurvey,
    Run,
    by_run,
    chained,
    label,
    placed,
    survey,
)
from sonarmap.tools.lab.reproduce.plan import OUTLINE, SectionPlan, draw_plan, from_above, plan
from sonarmap.tools.lab.reproduce.rows import column, where
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from sonarmap.tools.products.report.small_png import save_small

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

PLAN_HEIGHT = -4.0  # of the section through the scene: the water's surface is at 0 [m]
CELL = 0.5  # [m]
LIMITS = (1.0, 3.0)  # between near, off and far off [m]
_COLUMNS = 3

_TRUE: dict[str, Any] = {"color": "black", "linewidth": 2.4}
_ESTIMATED: dict[str, Any] = {"color": "magenta", "linewidth": 1.2, "marker": "o", "markersize": 2.5}
_NAMES = ("x [m]", "y [m]", "z [m]", "yaw [degrees]", "roll [degrees]", "pitch [degrees]")
_LEAST_ROOM = 2.0  # above and below the true values [m or degrees]; what is farther off is shown at the rim
_COARSE = 128  # voxels per edge: open marks
_TRUE_LINE: dict[str, Any] = {"color": "black", "linewidth": 1.6}

PICTURES: Mapping[str, str] = MappingProxyType(
    {
        "floodgate-maps.png": "The maps from above, as Figs. 25, 28 and 30, colored by the height of the highest "
        "point. Thin black outlines show what is solid 4 m below the water's surface. The true path is black, the "
        "estimated path magenta; both start at the same pose.",
        "floodgate-errors.png": "The same maps, colored by the distance of each point from the true surface; points "
        "with larger errors are drawn on top. Gray is solid.",
        "floodgate-motion.png": "Motion estimates, as Fig. 31, from each scan to the next, with the true motion. Marks "
        "at the edge of a plot stand for values beyond it.",
        "floodgate-poses.png": "Growth of the errors along the chain.",
        "floodgate-scans.png": "Two of the scans, as Fig. 24, colored by height; the few echoes far from the rest are "
        "left out. The sensor is magenta.",
    }
)


def draw_floodgate(folder: Path, rows: Sequence[Row], settings: Any) -> None:
    """Write PICTURES of the first survey; `settings` are FloodgateSettings."""
    maps, errors, motion, poses, examples = (folder / name for name in PICTURES)
    now = survey(settings.first_seed, settings.scans)
    first = where(rows, seed=settings.first_seed)
    _draw_maps(maps, errors, first, now)
    _draw_motion(motion, by_run(first, PAIR))
    _draw_poses(poses, by_run(first, POSE))
    _draw_scans(examples, now)


def _shown(runs: Iterable[Run]) -> list[Run]:
    """The methods that are about the paper's, each on its finest grid."""
    paper = [run for run in runs if COMPARED[run[0]].in_figures] or list(runs)
    return [run for run in paper if run == max(other for other in paper if other[0] == run[0])]


@dataclass(frozen=True, slots=True)
class _Panel:
    """One map: its title, points [m, world], their distances to the true surface [m], and the poses."""

    title: str
    points: np.ndarray
    distance: np.ndarray
    poses: RigidTransform


def _draw_maps(heights: Path, errors: Path, rows: Sequence[Row], now: FloodgateSurvey) -> None:
    """Write both pictures of one survey: the plan with the true poses, then one panel for each map."""
    pairs, made = by_run(rows, PAIR), by_run(rows, POSE)
    section = plan(now.mesh, PLAN_HEIGHT)
    poses = {(TRUTH, 0): now.T_world_sensor}
    poses |= {run: now.T_world_sensor[0] * chained(pairs[run], "found") for run in _shown(pairs)}
    panels = []
    for run, T_world_sensor in poses.items():
        points = placed(now, T_world_sensor)
        title = f"{label(*run)}: 90 % within {made[run][-1][MAP_90]:.1f} m"
        panels.append(_Panel(title, points, surface_distance(now.mesh, points), T_world_sensor))
    _draw_heights(heights, section, panels, now)
    _draw_errors(errors, section, panels, now)


def _draw_heights(path: Path, section: SectionPlan, panels: Sequence[_Panel], now: FloodgateSurvey) -> None:
    low, high = np.quantile(panels[0].points[:, 2], [0.01, 0.995])
    figure, grid = _grid(len(panels))
    image: Any = None
    for axes, panel in zip(grid, panels, strict=False):
        image = _from_above(axes, panel.points, panel.points[:, 2], section, cmap="viridis", vmin=low, vmax=high)
        draw_plan(axes, section, filled=False)
        _finish(axes, panel, now, section)
    figure.colorbar(image, ax=grid, label="height z of the highest point [m]", shrink=0.6, pad=0.01)
    _explain(figure, [])
    save_small(figure, path)


def _draw_errors(path: Path, section: SectionPlan, panels: Sequence[_Panel], now: FloodgateSurvey) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colors = ("tab:blue", "tab:orange", "tab:red")
    figure, grid = _grid(len(panels))
    for axes, panel in zip(grid, panels, strict=False):
        draw_plan(axes, section)
        kind = np.digitize(panel.distance, LIMITS).astype(float)
        # what is wrong lies over what is right, whatever their heights
        points = np.column_stack([panel.points[:, :2], kind])
        _from_above(axes, points, kind, section, cmap=ListedColormap(colors), vmin=-0.5, vmax=2.5)
        _finish(axes, panel, now, section)
    near, far = (f"{limit:g}" for limit in LIMITS)
    names = (f"within {near} m of the true surface", f"{near} to {far} m off", f"more than {far} m off")
    _explain(figure, [Patch(color=color, label=name) for color, name in zip(colors, names, strict=True)])
    save_small(figure, path)


def _from_above(axes: "Axes", points: np.ndarray, values: np.ndarray, section: SectionPlan, **colors: Any) -> Any:
    seen, half = from_above(points, values, section.edge, CELL), section.edge / 2
    extent = (-half, half, -half, half)
    return axes.imshow(np.ma.masked_invalid(seen.T), origin="lower", extent=extent, interpolation="nearest", **colors)


def _explain(figure: "Figure", patches: Sequence["Patch"]) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], label=f"true plan at z = {PLAN_HEIGHT:g} m", **OUTLINE),
        Line2D([], [], label="true path", **_TRUE),
        Line2D([], [], label="estimated path", **_ESTIMATED),
    ]
    handles = [*patches, *lines]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


def _grid(count: int) -> tuple["Figure", Any]:
    return new_panels(count, _COLUMNS, (5.0, 5.1), (0.8, 0.4), dpi=110)


def _finish(axes: "Axes", panel: _Panel, now: FloodgateSurvey, section: SectionPlan) -> None:
    """Draw the estimated path and the true one, and finish the panel."""
    half = section.edge / 2
    axes.plot(*now.T_world_sensor.translation[:, :2].T, **_TRUE)
    axes.plot(*panel.poses.translation[:, :2].T, **_ESTIMATED)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set_title(panel.title, fontsize=11)
    axes.tick_params(labelsize=8)


_STRAY = 0.004  # share of the echoes that is left out at either end of each axis, so that the rest is seen


def _draw_scans(path: Path, now: FloodgateSurvey) -> None:
    """Write the scans at a quarter and at three quarters of the survey in perspective, colored by depth."""
    figure = new_figure(14, 6.2, dpi=110)
    count = len(now.scans)
    for k, number in enumerate((count // 4, 3 * count // 4)):
        scan, T = now.scans[number], now.T_world_sensor[number]
        points = T.apply(scan.points.astype(np.float64))
        low, high = np.quantile(points, [_STRAY, 1 - _STRAY], axis=0)
        near = points[((points >= low) & (points <= high)).all(axis=1)]
        axes: Any = figure.add_subplot(1, 2, k + 1, projection="3d", computed_zorder=False)
        axes.scatter(*near.T, c=near[:, 2], s=2.0, cmap="viridis", linewidths=0)
        axes.scatter(*T.translation, color="magenta", s=30)
        heading = np.rad2deg(T.rotation.as_euler("ZYX")[0])
        axes.view_init(elev=28, azim=heading + 180)
        axes.set_box_aspect(np.maximum(np.ptp(near, axis=0), 1.0), zoom=0.98)
        axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        axes.set_title(f"scan {number}: {len(points):,} points", fontsize=11)
    save_small(figure, path)


def _draw_motion(path: Path, pairs: Mapping[Run, list[Row]]) -> None:
    """Write x, y, z, yaw, roll and pitch between consecutive scans of one survey: true lines, estimated marks."""
    figure = new_figure(15, 8.2, dpi=110)
    first = next(iter(pairs.values()))
    source = [int(row["scan"]) for row in first]
    panels = figure.subplots(2, 3, sharex=True).ravel()
    for axes, parameter, name in zip(panels, PARAMETERS, _NAMES, strict=True):
        true = column(first, f"true_{parameter}")
        room = max(_LEAST_ROOM, float(np.ptp(true)) / 2)
        low, high = true.min() - room, true.max() + room
        axes.plot(source, true, "-", label="true", **_TRUE_LINE)
        for run in _shown(pairs):
            estimated = column(pairs[run], f"found_{parameter}").clip(low, high)
            axes.plot(source, estimated, linestyle="none", clip_on=False, zorder=3, **_style(run))
        axes.set(ylabel=name, ylim=(low, high))
        axes.grid(alpha=0.3)
        axes.set_xticks(source, [f"{k - 1}→{k}" for k in source], rotation=90, fontsize=8)
    legend_below(figure, panels[-1])
    save_small(figure, path)


def _draw_poses(path: Path, poses: Mapping[Run, list[Row]]) -> None:
    """Write how the error of the poses grows along the chain of one survey, by method, and the map's with it."""
    figure = new_figure(15, 4.8, dpi=110)
    panels = figure.subplots(1, 3)
    names = ("error of the pose [m]", "error of the pose [degrees]", "90 % of the map so far within [m]")
    scans = range(1, len(poses[TRUTH, 0]))
    for axes, key, name in zip(panels, ("translation_m", "rotation_deg", MAP_90), names, strict=True):
        for run, rows in poses.items():
            if run[0] != TRUTH:
                axes.plot(scans, column(rows, key)[1:], linewidth=1.2, **_style(run))
        _logarithmic(axes, name)
        axes.set_xticks(scans[::2])
    panels[-1].plot(scans, column(poses[TRUTH, 0], MAP_90)[1:], "-", label=TRUTH, **_TRUE_LINE)
    legend_below(figure, panels[-1])
    save_small(figure, path)


def _logarithmic(axes: "Axes", name: str) -> None:
    """Plain numbers at 1, 2 and 5 of every decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="scan", ylabel=name)
    axes.grid(alpha=0.3)


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
