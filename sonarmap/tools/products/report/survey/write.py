"""Figures as files."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.products.report.small_png import save_small

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_png(
    make: Callable[[], "Figure"], path: Path, inks: Sequence[str] = (), ramp: np.ndarray | None = None
) -> None:
    """Make a figure, and write it as a PNG of few colors: `inks` and `ramp` are those of `save_small`.

    Raises:
        InputError: the file cannot be written.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names in other scripts are drawn as boxes
        save_small(make(), path, inks, ramp)
