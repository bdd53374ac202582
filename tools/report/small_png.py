"""Figures as small PNGs, for pages that hold many."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from tools.writers.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = 192
_WHITE = 250  # levels that fewer colors leave of the white ground


def save_small(figure: "Figure", path: Path) -> None:
    """Write a PNG of few colors, a third as large as Matplotlib's.

    Raises:
        InputError: the file cannot be written.
    """
    from PIL import Image

    drawn = BytesIO()
    figure.savefig(drawn, format="png")
    with Image.open(drawn) as image, atomic_path(path) as temporary:
        few = image.convert("RGB").quantize(_COLORS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        few.putpalette([255 if level >= _WHITE else level for level in few.getpalette() or ()])
        few.save(temporary, format="png", optimize=True)
