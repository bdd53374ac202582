"""The maps from above over the true plan (the paper's Figs. 25, 28, 30), by height and by what is wrong with them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.reproduce.figure import new_figure
from sonarmap.tools.lab.reproduce.floodgate.chain import FloodgateSurvey, survey
from sonarmap.tools.lab.reproduce.floodgate.methods import TRUTH, label
from sonarmap.tools.lab.reproduce.floodgate.motion_figure import draw_motion, draw_poses
from sonarmap.tools.lab.reproduce.floodgate.tables import Chain, Chains, map_90, runs_of, shown
from sonarmap.tools.lab.reproduce.plan import SectionPlan, draw_plan, from_above, plan
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
    columns = min(count, _COLUMNS)
    lines = -(-count // columns)
    figure = new_figure(5.0 * columns + 0.8, 5.1 * lines + 0.4, dpi=110)
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


_STRAY = 0.004  # share of the echoes that is left out at either end of each axis, so that the rest is seen


def draw_scans(path: Path, now: FloodgateSurvey) -> None:
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


def draw_floodgate(folder: Path, chains: Chains, seed: int, scans: int) -> None:
    """Write PICTURES into an existing folder, of one survey."""
    maps, errors, motion, poses, examples = (folder / name for name in PICTURES)
    now = survey(seed, scans)
    draw_maps(maps, errors, now, chains, seed)
    draw_motion(motion, chains, seed)
    draw_poses(poses, chains, seed)
    draw_scans(examples, now)
