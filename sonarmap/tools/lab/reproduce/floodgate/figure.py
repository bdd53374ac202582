"""All pictures of the flood gate, what they show, and two of the scans as point clouds (the paper's Fig. 24)."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.floodgate.maps_figure import draw_maps
from sonarmap.tools.lab.reproduce.floodgate.motion_figure import draw_motion, draw_poses
from sonarmap.tools.lab.reproduce.floodgate.survey import FloodgateSurvey, survey
from sonarmap.tools.lab.reproduce.floodgate.tables import Chains
from sonarmap.tools.products.report.small_png import save_small

_STRAY = 0.004  # share of the echoes that is left out at either end of each axis, so that the rest is seen


def draw_scans(path: Path, now: FloodgateSurvey) -> None:
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
