"""The estimated paths of every system over the true plan of the scene, before and after its loops."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.plan import plan
from sonarmap.tools.lab.reproduce.plan_picture import draw_plan
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.survey.row import MAP, POSE
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.products.report.small_png import save_small

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLAN_HEIGHT = -4.0  # of the section through the scene: the water's surface is at 0 [m]
_WAYS: dict[str, dict[str, Any]] = {
    "true": {"color": "black", "linewidth": 2.4, "label": "true"},
    "before": {"color": "tab:orange", "linewidth": 1.0, "label": "before loops"},
    "after": {"color": "magenta", "linewidth": 1.2, "marker": "o", "markersize": 2.0, "label": "estimated"},
}


def draw_ways(path: Path, rows: Sequence[Row], scene: str, seed: int, survey: str) -> None:
    """Write a PNG of one survey, each way survey over the true one.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    chosen = where(rows, seed=seed, survey=survey)
    maps = where(chosen, row=MAP)
    section = plan(build_scene(scene, seed).mesh, PLAN_HEIGHT)
    figure = Figure(figsize=(5.2 * len(maps) + 0.4, 5.8), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(maps), squeeze=False)[0]
    for axes, mapped in zip(panels, maps, strict=True):
        draw_plan(axes, section)
        poses = where(chosen, row=POSE, system=mapped["system"])
        for name, style in _WAYS.items():
            _draw_way(axes, poses, name, style)
        half = section.edge / 2
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel="x [m]")
        axes.set_title(f"{mapped['system']}: {float(mapped['ate_after_voxels']):.2f} voxels off", fontsize=11)
    panels[0].set_ylabel("y [m]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    save_small(figure, path)


def _draw_way(axes: "Axes", poses: Sequence[Row], name: str, style: dict[str, Any]) -> None:
    if poses and f"x_{name}_m" in poses[0]:
        axes.plot(*np.array([[float(row[f"{axis}_{name}_m"]) for axis in "xy"] for row in poses]).T, **style)
