"""Two of the scans as point clouds (the paper's Fig. 24)."""

from pathlib import Path
from typing import Any

import numpy as np

from tools.report.small_png import save_small
from tools.reproduce.floodgate.survey import Survey

_STRAY = 0.004  # share of the echoes that is left out at either end of each axis, so that the rest is seen


def draw_scans(path: Path, now: Survey) -> None:
    """Write the scans at a quarter and at three quarters of the survey in perspective, colored by depth."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 6.2), dpi=110, layout="constrained")
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
