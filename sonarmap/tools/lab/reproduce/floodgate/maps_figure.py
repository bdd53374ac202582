"""The maps from above over the true plan (the paper's Figs. 25, 28, 30), by height and by what is wrong with them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.reproduce.floodgate.methods import TRUTH, label
from sonarmap.tools.lab.reproduce.floodgate.survey import FloodgateSurvey
from sonarmap.tools.lab.reproduce.floodgate.tables import Chain, Chains, map_90, runs_of, shown
from sonarmap.tools.lab.reproduce.plan import SectionPlan, plan
from sonarmap.tools.lab.reproduce.plan_picture import draw_plan, from_above
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

_PLAN: dict[str, Any] = {"color": "black", "linewidth": 0.6}
_TRUE: dict[str, Any] = {"color": "black", "linewidth": 2.4}
_ESTIMATED: dict[str, Any] = {"color": "magenta", "linewidth": 1.2, "marker": "o", "markersize": 2.5}


@dataclass(frozen=True, slots=True)
class _Panel:
    """One map: its title, points [m, world], their distances to the true surface [m], and the poses."""

    title: str
    points: np.ndarray
    distance: np.ndarray
    poses: RigidTransform


def draw_maps(heights: Path, errors: Path, now: FloodgateSurvey, chains: Chains, seed: int) -> None:
    """Write both pictures of one survey: the plan with the true poses, then one panel for each map."""
    section = plan(now.mesh, PLAN_HEIGHT)
    panels = [_panel(now, TRUTH, now.T_world_sensor, chains[seed, TRUTH, 0])]
    for run in shown(runs_of(chains)):
        chain = chains[seed, *run]
        panels.append(_panel(now, label(*run), now.T_world_sensor[0] * chain.found, chain))
    _draw_heights(heights, section, panels, now)
    _draw_errors(errors, section, panels, now)


def _panel(now: FloodgateSurvey, name: str, poses: RigidTransform, chain: Chain) -> _Panel:
    points = np.concatenate([T.apply(s.points.astype(np.float64)) for T, s in zip(poses, now.scans, strict=True)])
    title = f"{name}: 90 % within {map_90(chain):.1f} m"
    return _Panel(title, points, surface_distance(now.mesh, points), poses)


def _draw_heights(path: Path, section: SectionPlan, panels: Sequence[_Panel], now: FloodgateSurvey) -> None:
    low, high = np.quantile(panels[0].points[:, 2], [0.01, 0.995])
    figure, grid = _grid(len(panels))
    image: Any = None
    for axes, panel in zip(grid, panels, strict=False):
        seen = from_above(panel.points, panel.points[:, 2], section.edge, CELL)
        half = section.edge / 2
        image = axes.imshow(
            np.ma.masked_invalid(seen.T),
            origin="lower",
            extent=(-half, half, -half, half),
            cmap="viridis",
            vmin=low,
            vmax=high,
            interpolation="nearest",
        )
        draw_plan(axes, section, filled=False)
        _finish(axes, panel, now, section)
    figure.colorbar(image, ax=grid, label="height z of the highest point [m]", shrink=0.6, pad=0.01)
    _legend(figure, [])
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
        seen = from_above(np.column_stack([panel.points[:, :2], kind]), kind, section.edge, CELL)
        half = section.edge / 2
        axes.imshow(
            np.ma.masked_invalid(seen.T),
            origin="lower",
            extent=(-half, half, -half, half),
            cmap=ListedColormap(colors),
            vmin=-0.5,
            vmax=2.5,
            interpolation="nearest",
        )
        _finish(axes, panel, now, section)
    near, far = (f"{limit:g}" for limit in LIMITS)
    names = (f"within {near} m of the true surface", f"{near} to {far} m off", f"more than {far} m off")
    _legend(figure, [Patch(color=color, label=name) for color, name in zip(colors, names, strict=True)])
    save_small(figure, path)


def _legend(figure: "Figure", patches: Sequence["Patch"]) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], label=f"true plan at z = {PLAN_HEIGHT:g} m", **_PLAN),
        Line2D([], [], label="true path", **_TRUE),
        Line2D([], [], label="estimated path", **_ESTIMATED),
    ]
    handles = [*patches, *lines]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


def _grid(count: int) -> tuple["Figure", Any]:
    from matplotlib.figure import Figure

    columns = min(count, _COLUMNS)
    lines = -(-count // columns)
    figure = Figure(figsize=(5.0 * columns + 0.8, 5.1 * lines + 0.4), dpi=110, layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid


def _finish(axes: "Axes", panel: _Panel, now: FloodgateSurvey, section: SectionPlan) -> None:
    """Draw the estimated path and the true one, and finish the panel."""
    half = section.edge / 2
    axes.plot(*now.T_world_sensor.translation[:, :2].T, **_TRUE)
    axes.plot(*panel.poses.translation[:, :2].T, **_ESTIMATED)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set_title(panel.title, fontsize=11)
    axes.tick_params(labelsize=8)
