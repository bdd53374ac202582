"""Pictures of few colors."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from sonarmap.tools.products.report.small_png import save_small


def test_in_a_small_png_white_stays_white_and_twice_is_the_same(tmp_path: Path) -> None:
    figure = Figure(figsize=(3, 2))
    figure.subplots().imshow(np.random.default_rng(1).random((40, 60)), cmap="viridis")
    first, second, large = (tmp_path / f"{name}.png" for name in ("a", "b", "large"))
    save_small(figure, first)
    save_small(figure, second)
    figure.savefig(large)
    assert first.read_bytes() == second.read_bytes()
    assert first.stat().st_size < large.stat().st_size
    with Image.open(first) as image:
        assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)
