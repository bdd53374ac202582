"""Turned structures as the paper draws them: estimated angles and shifts over the true yaw."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tools.atomic import atomic_path
from tools.reproduce.experiment import Row
from tools.reproduce.translation_figure import draw_series
from tools.reproduce.voxel_series import ROTATION, TRANSLATION, picked

PICTURE = "rotation.png"


def draw_rotation(path: Path, rows: Sequence[Row], noises: Sequence[str]) -> None:
    """Write a PNG: a line of axes per noise, rotation at the left, translation at the right."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.7 * len(noises) + 0.3), dpi=90, layout="constrained")
    axes = figure.subplots(len(noises), 2, squeeze=False, sharex=True)
    for (left, right), noise in zip(axes, noises, strict=True):
        some = picked(rows, noise=noise)
        yaw = np.array([row["true_yaw_deg"] for row in some])
        draw_series(left, yaw, some, ROTATION, "deg")
        draw_series(right, yaw, some, TRANSLATION, "m")
        left.set_title(f"{noise}: rotation", fontsize=10)
        right.set_title(f"{noise}: translation", fontsize=10)
        left.set_ylabel("estimated [degrees]")
        right.set_ylabel("estimated [m]")
        bound = max(5.0, *(1.1 * abs(float(row[f"found_{name}_m"])) for row in some for name in TRANSLATION))
        right.set_ylim(-bound, bound)
    for one in axes[-1]:
        one.set_xlabel("true yaw [degrees]")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
