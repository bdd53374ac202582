"""Figures as PNG files."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.files.writers.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_png(figure: "Figure", path: Path) -> None:
    """Draw a figure. The same figure gives the same bytes. Raises InputError: the file cannot be written."""
    with warnings.catch_warnings(), atomic_path(path) as temporary:
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # of a name's script: drawn as boxes
        figure.savefig(temporary, format="png")
