"""Table 1 as a picture, after the paper's Figs. 20 and 21: estimated and true parameters over S0..S9."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from tools.atomic import atomic_path
from tools.reproduce.gaussian import GaussianResult, GaussianRow, about_center
from tools.reproduce.methods import METHODS
from tools.simulate.series import TABLE1_COUNT

TRANSLATION, ROTATION = ("x", "y", "z"), ("yaw", "roll", "pitch")
_COLORS = ("tab:blue", "tab:orange", "tab:green")
_WRONG = "0.88"


def parameters(T_target_source: RigidTransform) -> np.ndarray:
    """x, y, z [m] and yaw, roll, pitch [degrees] about the grid's center, (6,), as Table 1 lists them."""
    T = about_center(T_target_source)
    yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True)
    return np.array([*T.translation, yaw, roll, pitch])


def draw_gaussian(path: Path, result: GaussianResult) -> None:
    """Write a PNG of the first seed: one column per method, two rows of axes per noise.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    settings = result.settings
    lines = 2 * len(settings.sigma2)
    figure = Figure(figsize=(4.2 * len(METHODS), 2.7 * lines + 0.8), dpi=120, layout="constrained")
    axes = figure.subplots(lines, len(METHODS), squeeze=False, sharex=True, sharey="row")
    for line, sigma2 in enumerate(settings.sigma2):
        for column, method in enumerate(METHODS):
            rows = [row for row in result.of(sigma2, method) if row.seed == settings.first_seed]
            upper, lower = axes[2 * line, column], axes[2 * line + 1, column]
            _draw_parameters(upper, rows, slice(0, 3), TRANSLATION)
            _draw_parameters(lower, rows, slice(3, 6), ROTATION)
            upper.set_title(f"{method}, σ² = {sigma2:g} m²", fontsize=11)
        axes[2 * line, 0].set_ylabel("translation [m]")
        axes[2 * line + 1, 0].set_ylabel("rotation [degrees]")
        for axis in axes[2 * line : 2 * line + 2, -1]:
            axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    for axis in axes[-1]:
        axis.set_xticks(range(TABLE1_COUNT), [f"S{index}" for index in range(TABLE1_COUNT)])
    figure.suptitle(
        f"Table 1 on {settings.scene}, {settings.edge} voxels of {settings.grid.voxel:g} m, seed "
        f"{settings.first_seed}: lines true, marks estimated, gray wrong"
    )
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def _draw_parameters(axes: Any, rows: list[GaussianRow], which: slice, names: tuple[str, ...]) -> None:
    """Three parameters: a line of true values and a mark for each estimate."""
    index = [row.index for row in rows]
    found = np.array([parameters(row.trial.registration.T_target_source)[which] for row in rows])
    true = np.array([parameters(row.trial.truth)[which] for row in rows])
    for row in rows:
        if not row.trial.right:
            axes.axvspan(row.index - 0.5, row.index + 0.5, color=_WRONG, linewidth=0)
    for k, (name, color) in enumerate(zip(names, _COLORS, strict=True)):
        axes.plot(index, true[:, k], "-", color=color, linewidth=1.2, label=f"{name} true")
        axes.plot(index, found[:, k], "x", color=color, markersize=6, markeredgewidth=1.6, label=f"{name} estimated")
    axes.set_xlim(-0.5, TABLE1_COUNT - 0.5)
    axes.grid(alpha=0.3)
