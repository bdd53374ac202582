"""Figures as small PNGs, for pages that hold many."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from PIL.Image import Image

_COLORS = 192
_WHITE = 250  # levels that fewer colors leave of the white ground
_MOST = 256  # colors in a palette
_SHADES = 12  # between white and an ink: what the edges of lines and letters have


def write_png(
    make: "Callable[[], Figure]", path: Path, inks: Sequence[str] = (), ramp: np.ndarray | None = None
) -> None:
    """Make a figure, and write it as `save_small` does; names in scripts that the font lacks are drawn as boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        save_small(make(), path, inks, ramp)


def save_small(figure: "Figure", path: Path, inks: Sequence[str] = (), ramp: np.ndarray | None = None) -> None:
    """Write a PNG of few colors, a third as large as Matplotlib's.

    The palette is made of what is drawn or, where they are given, of `inks`, the colors of lines and letters besides
    black, and of a ramp (k, 3) 0..1, the colors of images, thinned to what is left of the palette.

    Raises InputError: the file cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    known = _palette(inks, ramp) if inks or ramp is not None else None
    with atomic_path(path) as temporary:
        if known is None:
            few = image.quantize(_COLORS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
            few.putpalette([255 if level >= _WHITE else level for level in few.getpalette() or ()])
            few.save(temporary, format="png", optimize=True)
        else:
            image.quantize(palette=known, dither=Image.Dither.NONE).save(temporary, format="png")


def shrink(text: "Text", width: float) -> None:
    """Make a text of a figure small enough for a width [pixels]."""
    needed = text.get_window_extent().width
    text.set_fontsize(float(text.get_fontsize()) * min(1.0, width / max(needed, 1.0)))


def _palette(inks: Sequence[str], ramp: np.ndarray | None) -> "Image":
    """An image that has these colors."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    share = np.linspace(0, 1, _SHADES)[:, None]
    shades = np.concatenate([1 - share * (1 - np.array(to_rgb(ink))) for ink in ("black", *inks)])
    if ramp is not None:
        left = _MOST - len(shades)
        chosen = np.linspace(0, len(ramp) - 1, min(left, len(ramp))).round().astype(int)
        shades = np.concatenate([shades, ramp[chosen]])
    levels = (255 * shades).round().astype(np.uint8)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.pad(levels, ((0, _MOST - len(levels)), (0, 0)), mode="edge").tobytes())
    return palette
