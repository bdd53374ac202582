"""Figures as files."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from tools.writers.atomic import atomic_path

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure


def write_png(make: "Callable[[], Figure]", path: Path) -> None:
    """Make a figure, and write it as a PNG.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_path(path) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names in other scripts are drawn as boxes
        make().savefig(temporary, format="png")
