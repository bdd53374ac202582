"""The roofline: how fast each kernel computes, over how much it computes for each byte, under what the device gives."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kernels.errors import InputError
from tools.writers.atomic import atomic_path

# Bytes for each voxel that a transform touches: the volume, and its spectrum twice.
_TOUCHED = 12
_COLORS = ("#1f5f8b", "#d1495b", "#2a9d4a", "#c98b1b", "#6a4c93", "#555555")


def draw_roofline(path: Path, result: Mapping[str, Any]) -> None:
    """Draw the kernels of a result, as `as_json` gives it: a color for each grid, its memory's rate as a line.

    Raises:
        InputError: the result holds no kernels, or the file cannot be written.
    """
    rows = [row for row in result["kernels"] if row.get("flops") and row["right"]]
    if not rows:
        raise InputError("the result holds no kernels to draw; leave --no-kernels out")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.add_subplot()
    intensity = np.array([row["flops"] / row["bytes_moved"] for row in rows])
    span = np.geomspace(intensity.min() / 2, max(intensity.max(), 10) * 2, 200)
    for color, grid in zip(_COLORS * 8, dict.fromkeys(row["grid"] for row in rows), strict=False):
        own = [row for row in rows if row["grid"] == grid]
        rate = _memory_rate(result, _TOUCHED * grid**3)
        axes.plot(span, np.minimum(rate * span, result["flops"]) / 1e9, color=color, lw=1)
        x = [row["flops"] / row["bytes_moved"] for row in own]
        y = [row["flop_rate"] / 1e9 for row in own]
        axes.plot(x, y, "o", color=color, ms=5, label=f"{grid}³, memory in place {rate / 1e9:.0f} GB/s")
        if grid == rows[-1]["grid"]:
            for row, at in zip(own, zip(x, y, strict=True), strict=True):
                axes.annotate(row["kernel"], at, textcoords="offset points", xytext=(5, -9), fontsize=7, color=color)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="operations for each byte that must be moved",
        ylabel="GFLOP/s",
        title=f"{result['device']['name']}: kernels under the device's limits",
    )
    axes.grid(alpha=0.25, which="both")
    axes.legend(frameon=False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def _memory_rate(result: Mapping[str, Any], touched: int) -> float:
    rates = {int(size): rate for size, rate in result["rates"]["in_place"].items()}
    large = [rate for size, rate in rates.items() if size >= touched / 2]
    return max(large) if large else rates[max(rates)]
