"""What the figures of the evaluation share: a color per method, and curves of rates."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.methods import EVALUATED, OURS
from sonarmap.tools.lab.reproduce.rate import Rate

DPI = 100


def style(method: str) -> dict[str, Any]:
    """Ours stands out; each method looks the same in every figure."""
    color = f"C{EVALUATED.index(method)}" if method in EVALUATED else "k"
    return {"color": color, "linewidth": 2.2 if method == OURS else 1.1, "zorder": 3 if method == OURS else 2}


def draw_rates(axes: Any, places: Sequence[float], rates: Sequence[Rate], method: str, mark: str = "o") -> None:
    """A curve of rates over the places; ours with the band of their intervals."""
    share = np.array([rate.successes / rate.trials for rate in rates])
    look = style(method)
    axes.plot(places, share, f"{mark}-", markersize=4, label=method, **look)
    if method == OURS:
        low, high = np.array([rate.low for rate in rates]), np.array([rate.high for rate in rates])
        axes.fill_between(places, low, high, color=look["color"], alpha=0.22, linewidth=0)
