"""The roofline: how fast each kernel computes, over how much it computes for each byte, under what the device gives."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.bench.rates import highest_rate
from sonarmap.tools.products.report.labels import place_labels, shrink
from sonarmap.tools.products.report.small_png import write_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Bytes for each voxel that a transform touches: the volume, and its spectrum twice.
_TOUCHED = 12
# Okabe and Ito's, which no kind of color blindness mixes up, and shapes for gray prints.
_LOOKS = (("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#E69F00", "v"), ("#555555", "P"))
_LEFT, _END = 0.075, 0.98  # of the panel [figure's width]
_DOT = 6.0  # half the width of a point [pixels]
_DISTANCES = (6.0, 10.0, 18.0, 28.0, 40.0, 55.0, 75.0, 100.0)  # from a point to its label [pt]


def draw_roofline(path: Path, result: Mapping[str, Any]) -> None:
    """Draw the kernels of a result: a color for each grid, its memory's rate as a line.

    Raises:
        InputError: the result holds no kernels, or the file cannot be written.
    """
    write_png(lambda: roofline_figure(result), path, [color for color, _ in _LOOKS])


def roofline_figure(result: Mapping[str, Any]) -> "Figure":
    """The figure; the kernels of the last grid have their names.

    Raises:
        InputError: the result holds no kernels.
    """
    rows = [row for row in result["kernels"] if row.get("flops") and row["right"]]
    if not rows:
        raise InputError("the result holds no kernels to draw; leave --no-kernels out")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7.2), dpi=140)
    axes = figure.add_axes((_LEFT, 0.085, _END - _LEFT, 0.815))
    places = np.array([_place(row) for row in rows])
    span = np.geomspace(places[:, 0].min() / 2, max(places[:, 0].max(), 10) * 2, 200)
    roofs, in_place = [], {int(size): rate for size, rate in result["rates"]["in_place"].items()}
    for (color, shape), grid in zip(_LOOKS * 8, dict.fromkeys(row["grid"] for row in rows), strict=False):
        rate = highest_rate(in_place, _TOUCHED * grid**3)
        roof = np.minimum(rate * span, result["flops"]) / 1e9
        axes.plot(span, roof, color=color, lw=1)
        own = np.array([_place(row) for row in rows if row["grid"] == grid])
        label = f"{grid}³; line: memory changed in place at {rate / 1e9:.0f} GB/s"
        axes.plot(*own.T, shape, color=color, ms=6, label=label)
        roofs.append(np.column_stack([span, roof]))
    axes.set(xscale="log", yscale="log", xlabel="operations for each byte that must be moved", ylabel="GFLOP/s")
    named = [row for row in rows if row["grid"] == rows[-1]["grid"]]
    title = f"{result['device']['name']}: how fast the kernels compute, and what limits them"
    words = f"named are the kernels at {rows[-1]['grid']}³; flat: {result['flops'] / 1e9:.0f} GFLOP/s of the device"
    for height, line, size, weight in ((0.955, title, 15, "bold"), (0.918, words, 10.5, "normal")):
        shrink(figure.text(_LEFT, height, line, fontsize=size, weight=weight), (_END - _LEFT) * figure.bbox.width)
    axes.grid(alpha=0.25, which="both")
    legend = axes.legend(loc="upper left", frameon=False)
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    taken = [np.array(legend.get_window_extent(FigureCanvasAgg(figure).get_renderer()).extents).tolist()]
    taken += [[x - _DOT, y - _DOT, x + _DOT, y + _DOT] for x, y in axes.transData.transform(places).tolist()]
    style: dict[str, Any] = {"covered": np.concatenate(roofs), "taken": taken, "distances": _DISTANCES}
    named_at, texts = np.array([_place(row) for row in named]), [row["kernel"] for row in named]
    place_labels(axes, named_at, texts, **style, fontsize=8.5, color="0.15")
    return figure


def _place(row: Mapping[str, Any]) -> tuple[float, float]:
    """Operations for each byte, and GFLOP/s, of a kernel."""
    return row["flops"] / row["bytes_moved"], row["flop_rate"] / 1e9
