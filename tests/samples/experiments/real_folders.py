"""Folders laid out as those of real scans, with a gt.log, of two simulated scans."""

from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.lab.simulate.random_pairs import random_pair


@cache
def simulated() -> tuple[Scan, Scan, RigidTransform]:
    return random_pair(3, (0.7, 0.9), scene="clutter")


def gt_log(i: int, j: int, T: RigidTransform) -> str:
    rows = "\n".join(" ".join(f"{value:.9f}" for value in row) for row in T.as_matrix())
    return f"{i} {j}\n{rows}\n"


def put(folder: Path, names: tuple[str, str] = ("0.npy", "cloud_bin_1.ply")) -> Path:
    """Write a folder of one pair."""
    folder.mkdir(parents=True, exist_ok=True)
    target, source, T = simulated()
    for name, scan in zip(names, (target, source), strict=True):
        if name.endswith("npy"):
            np.save(folder / name, scan.points)
        else:
            write_ply(folder / name, scan.points)
    (folder / "gt.log").write_text(gt_log(0, 1, T))
    return folder
