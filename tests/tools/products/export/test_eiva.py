"""Text for EIVA NaviEdit, against its page's layout and numbers worked by hand."""

import re
from pathlib import Path

import numpy as np

from sonarmap.tools.products.export.eiva import write_eiva_attitude, write_eiva_position
from sonarmap.tools.products.export.georeferenced import Georeferenced
from tests.tools.products.export.poses import dive


def texts(path: Path, earth: Georeferenced) -> tuple[str, str]:
    write_eiva_position(path / "position.txt", earth)
    write_eiva_attitude(path / "attitude.txt", earth)
    return (path / "position.txt").read_text(), (path / "attitude.txt").read_text()


def test_the_layout_is_that_of_the_page(tmp_path: Path) -> None:
    """1179179101.202228 1.134059548584164 0.1130091400934067 349.1989770603225"""
    for text, columns in zip(texts(tmp_path, dive()), (4, 4), strict=True):
        for line in text.splitlines():
            assert re.fullmatch(r"\d{10}\.\d{6}" + r" -?\d+\.\d{5,}" * (columns - 1), line)


def test_lines_ascend_in_time(tmp_path: Path) -> None:
    stamps = 1.7e9 + np.array([30.0, 31, 32, 0, 1, 2])
    for text, first in zip(texts(tmp_path, dive(stamps=stamps)), (29.75, None), strict=True):
        table = np.loadtxt(text.splitlines())
        np.testing.assert_array_equal(table[:, 0], np.sort(stamps))
        assert first is None or table[0, 3] == first  # the depth of scan 3
