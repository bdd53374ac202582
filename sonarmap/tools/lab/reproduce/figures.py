"""The pictures of the experiments, at most one each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.experiments import Settings
from sonarmap.tools.lab.reproduce.floodgate import MAP_90, PAIR, PAPER_METHODS, POSE, TRUTH, chained, placed, survey
from sonarmap.tools.lab.reproduce.registrations import EVALUATED, OURS
from sonarmap.tools.lab.reproduce.render import Frame, where, wilson
from sonarmap.tools.lab.reproduce.tables import expected_error, with_bins, worst_first
from sonarmap.tools.lab.simulate.scenes.bed import SCENE_EDGE
from sonarmap.tools.lab.simulate.scenes.solids import Mesh

_TENTHS = (-1e-9, *(k / 10 for k in range(1, 11)))
_WRONG = "0.88"  # the gray behind wrong registrations
_PANELS = (("rotation", ("yaw", "roll", "pitch"), "deg"), ("translation", ("x", "y", "z"), "m"))
_LEAST_SPAN = 10.0  # smallest range of vertical axes [degrees, m], so that small errors look small
_PLAN_HEIGHT = -4.0  # height of the section through the flood gate, relative to the water surface [m]


@dataclass(frozen=True, slots=True)
class Figure:
    """A picture: its caption, and a function that writes it as PNG from an experiment's rows and settings."""

    caption: str
    draw: Callable[[Path, Frame, Settings], None]
    rows: str = ""  # condition of the rows that it shows; without such rows there is no picture


def panels(lines: int, columns: int, width: float, height: float, **shared: Any) -> tuple[Any, np.ndarray]:
    """An empty figure and its axes (lines, columns), each of `width` by `height` [inches]."""
    from matplotlib.figure import Figure as Plot

    plot = Plot(figsize=(width * columns, height * lines), dpi=90, layout="constrained")
    axes = plot.subplots(lines, columns, squeeze=False, **shared)
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    return plot, axes


def save(plot: Any, path: Path, legend: Any = None) -> None:
    """Write a figure as PNG, with the legend of the axes `legend` below it."""
    if legend is not None:
        lines, names = legend.get_legend_handles_labels()
        plot.legend(lines, names, loc="outside lower center", ncols=min(len(names), 8), frameon=False, fontsize=8)
    plot.savefig(path, format="png")


def draw_rates(axes: Any, groups: Sequence[tuple[float, Frame]], **style: Any) -> None:
    """Draw the share right of each group at its horizontal position, with 95 % intervals."""
    places, share = [place for place, _ in groups], np.array([some["right"].mean() for _, some in groups], float)
    bounds = np.array([wilson(int(some["right"].sum()), len(some)) for _, some in groups]).T
    axes.errorbar(places, share, yerr=np.abs(bounds - share), markersize=4, elinewidth=0.6, **style)
    axes.set_ylim(-0.05, 1.05)


def draw_translation(path: Path, frame: Frame, settings: Settings) -> None:
    """Draw the first seed of the first scene with the strongest noises, as Fig. 15."""
    _draw_series(path, frame, settings, ("D2", "D4", "D6"), "distance_m", "true distance [m]")


def draw_rotation(path: Path, frame: Frame, settings: Settings) -> None:
    """Draw the first seed of the first scene, as Figs. 16 and 17."""
    _draw_series(path, frame, settings, settings.noises, "true_yaw_deg", "true yaw [degrees]")


def _draw_series(path: Path, frame: Frame, settings: Settings, noises: Sequence[str], over: str, label: str) -> None:
    """Draw a line of axes per noise, rotation left, translation right: true values as lines, estimates as crosses."""
    noises = [noise for noise in noises if noise in settings.noises] or settings.noises[:1]
    first = frame[(frame["scene"] == settings.scenes[0]) & (frame["seed"] == settings.first_seed)]
    plot, axes = panels(len(noises), 2, 5.0, 2.8, sharex=True)
    for noise, line in zip(noises, axes, strict=True):
        some = first[first["noise"] == noise]
        half = float(np.min(np.diff(some[over]))) / 2 if len(some) > 1 else 1.0
        for axis, (what, names, unit) in zip(line, _PANELS, strict=True):
            for place in some[over][~some["right"].astype(bool)]:
                axis.axvspan(place - half, place + half, color=_WRONG, linewidth=0)
            for k, name in enumerate(names):
                axis.plot(some[over], some[f"true_{name}_{unit}"], color=f"C{k}", linewidth=1.2)
                axis.plot(some[over], some[f"found_{name}_{unit}"], "x", color=f"C{k}", label=name)
            low, high = axis.get_ylim()
            if high - low < _LEAST_SPAN:
                axis.set_ylim((low + high - _LEAST_SPAN) / 2, (low + high + _LEAST_SPAN) / 2)
            axis.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
            axis.set(title=f"{noise}: {what}", ylabel=f"estimated [{'degrees' if unit == 'deg' else unit}]")
    for axis in axes[-1]:
        axis.set_xlabel(label)
    save(plot, path)


def draw_limits(path: Path, frame: Frame, _settings: Settings) -> None:
    """Draw axes per angle and a dot per registration, colored by the tilted angles, as Fig. 9."""
    plot, axes = panels(1, 3, 4.0, 3.6)
    titles = {"yaw": "yaw, from its highest peak", "roll": "roll, yaw given", "pitch": "pitch, yaw given"}
    for axis, (name, title) in zip(axes[0], titles.items(), strict=True):
        for k, kind in enumerate(("none", "roll", "pitch", "both")):
            some = frame[frame["tilted"] == kind]
            beside = some["tilt_deg"] + 0.6 * (k - 1)  # so that dots of the same tilt do not hide each other
            axis.plot(beside, some[f"{name}_off_deg"], ".", markersize=5, alpha=0.7, label=f"{kind} tilted")
        axis.set(title=title, xlabel="tilt [degrees]", ylabel="estimated - true [degrees]")
    save(plot, path, axes[0, 0])


def draw_floodgate(path: Path, frame: Frame, settings: Settings) -> None:
    """Draw the maps of the first survey from above, by the paper's methods and ours, each on its finest grid."""
    simulated = survey(settings.first_seed, settings.scans)
    first = frame[frame["seed"] == settings.first_seed]
    pairs = where(first, f"row == '{PAIR}'")
    maps = {(TRUTH, 0): simulated.T_world_sensor}
    for method, some in pairs.groupby("method", sort=False):
        if method in PAPER_METHODS:
            edge = some["grid"].max()
            rows = some[some["grid"] == edge].to_dict("records")
            maps[method, edge] = simulated.T_world_sensor[0] * chained(rows, "found")
    columns = min(len(maps), 3)
    plot, axes = panels(-(-len(maps) // columns), columns, 4.6, 4.8)
    heights = [float(z) for z in np.quantile(placed(simulated, simulated.T_world_sensor)[:, 2], [0.01, 0.995])]
    lines, image = outlines(simulated.mesh, _PLAN_HEIGHT), None
    for axis, ((method, edge), poses) in zip(axes.ravel(), maps.items(), strict=False):
        ends = where(first, f"row == '{POSE}' and method == '{method}' and grid == {edge}")
        image = _draw_map(axis, placed(simulated, poses), lines, heights)
        for T, style in ((simulated.T_world_sensor, "k-"), (poses, "m.-")):
            axis.plot(*T.translation[:, :2].T, style, linewidth=1.4, markersize=4)
        name = f"{method} {edge}³" if edge else method
        axis.set_title(f"{name}: 90 % within {ends[MAP_90].iloc[-1]:.1f} m", fontsize=11)
    for axis in axes.ravel()[len(maps) :]:
        axis.set_axis_off()
    plot.colorbar(image, ax=axes, label="height of the highest point [m]", shrink=0.6, pad=0.01)
    save(plot, path)


def _draw_map(axes: Any, points: np.ndarray, lines: np.ndarray, heights: Sequence[float]) -> Any:
    """Draw points from above, colored by height, the highest on top, over the outlines of the solids."""
    from matplotlib.collections import LineCollection

    x, y, z = points[np.argsort(points[:, 2], kind="stable")].T
    half = SCENE_EDGE / 2
    image = axes.scatter(x, y, s=0.4, c=z, vmin=heights[0], vmax=heights[1], linewidths=0, marker="s")
    axes.add_collection(LineCollection(list(lines), color="black", linewidth=0.6, zorder=4))
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    return image


def outlines(mesh: Mesh, height: float) -> np.ndarray:
    """(S, 2, 2) horizontal segments in which triangles intersect the plane at a height [m]."""
    corners = mesh.vertices[mesh.triangles]
    above = corners[:, :, 2] >= height
    cut = corners[above.any(axis=1) & ~above.all(axis=1)]
    start, end = cut, np.roll(cut, -1, axis=1)
    rise = end[:, :, 2] - start[:, :, 2]
    crossed = (start[:, :, 2] >= height) != (end[:, :, 2] >= height)  # always two of three sides
    share = (height - start[:, :, 2]) / np.where(crossed, rise, 1.0)
    places = start[:, :, :2] + share[:, :, None] * (end - start)[:, :, :2]
    return places[crossed].reshape(-1, 2, 2)


def draw_pairs(path: Path, frame: Frame, settings: Settings) -> None:
    """Draw the share right by overlap and method, with axes for any yaw and for any rotation."""
    plot, axes = panels(1, 2, 5.0, 4.0, sharey=True)
    for axis, turn in zip(axes[0], ("yaw", "any"), strict=True):
        of_turn = frame[frame["turn"] == turn]
        for method in settings.methods:
            selected = with_bins(of_turn[of_turn["method"] == method], "shared", _TENTHS, "tenth")
            groups = [(rows["shared"].mean(), rows) for _, rows in selected.groupby("tenth", observed=True)]
            color = f"C{EVALUATED.index(method)}" if method in EVALUATED else "k"
            draw_rates(axis, groups, fmt="o-", color=color, linewidth=2.2 if method == OURS else 1.1, label=method)
        axis.set(title=f"any {turn}" if turn == "yaw" else "any rotation", xlabel="share of the points in common")
    axes[0, 0].set_ylabel("share that is right")
    save(plot, path, axes[0, 0])


def draw_kinds(path: Path, frame: Frame, settings: Settings) -> None:
    """Draw the share right of our method against its reported probability, in ten bins, with axes per kind."""
    columns = min(4, len(settings.kinds))
    plot, axes = panels(-(-len(settings.kinds) // columns), columns, 2.7, 2.8, sharex=True, sharey=True)
    for axis, (kind, selected) in zip(axes.ravel(), worst_first(frame).groupby("kind", sort=False), strict=False):
        bins = with_bins(selected, "probability", _TENTHS, "tenth").groupby("tenth", observed=True)
        axis.plot([0, 1], [0, 1], "k--", linewidth=0.8)
        draw_rates(axis, [(rows["probability"].mean(), rows) for _, rows in bins], fmt="o-", color="C0")
        axis.set_title(f"{kind}: {expected_error(selected):.3f}", fontsize=9)
    plot.supxlabel("reported probability (mean of a bin)", fontsize=9)
    plot.supylabel("share that is right", fontsize=9)
    save(plot, path)


FIGURES: Mapping[str, Figure] = MappingProxyType(
    {
        "translation": Figure("Lines are true values, crosses are estimates; gray marks wrong ones.", draw_translation),
        "rotation": Figure("Lines are true values, crosses are estimates; gray marks wrong ones.", draw_rotation),
        "limits": Figure("Errors of the estimates against the tilt, as Fig. 9.", draw_limits),
        "floodgate": Figure(
            "The maps from above, as Figs. 25 and 30. Thin lines show what is solid 4 m below the surface; the "
            "true path is black, the estimated path magenta.",
            draw_floodgate,
        ),
        "pairs": Figure(
            "Share of right registrations against the overlap, with 95 % intervals.", draw_pairs, "set == 'overlap'"
        ),
        "kinds": Figure(
            f"How often `{OURS}` is right against the probability it reports, by kind.",
            draw_kinds,
            f"method == '{OURS}'",
        ),
    }
)
