"""How a map is divided over panels."""

import numpy as np
import pytest

from sonarmap.tools.products.report.survey.layout import layout


@pytest.mark.parametrize(
    ("size", "words"),
    [((100.0, 8.0), "top to bottom, each the next piece from left"), ((8.0, 100.0), "left to right, each the next")],
)
def test_a_map_in_strips_says_so(size: tuple[float, float], words: str) -> None:
    plan = layout(np.zeros(2), np.array(size))
    strips = plan.windows.shape[0] * plan.windows.shape[1]
    (sentence,) = plan.strips
    assert sentence.startswith(f"The map is cut into {strips} strips")
    assert words in sentence
    starts = plan.windows[:, :, 0, int(np.argmax(size))].ravel()  # in the order of reading
    assert (np.diff(starts) > 0).all()


def test_a_map_on_one_panel_says_nothing() -> None:
    assert layout(np.zeros(2), np.array([10.0, 9.0])).strips == []
