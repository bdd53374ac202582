"""What the third coordinate of a map means, and what else the page says of it."""

from pathlib import Path

import pytest

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.products.report.page.content import content_of
from tests.tools.products.export.finished import finished_map

HEIGHT = "height over the first scan"


@pytest.mark.parametrize(
    ("here", "label", "zero"),
    [
        (None, HEIGHT, None),
        (Georeference(60.0, 5.0), HEIGHT, None),  # on the Earth, but nothing says how high
        (Georeference(60.0, 5.0, -4.5, "MSL"), "depth below mean sea level", 4.5),
    ],
)
def test_depths_and_heights(tmp_path: Path, here: Georeference | None, label: str, zero: float | None) -> None:
    (part,) = content_of(read_map_folder(finished_map(tmp_path, georeference=here))).shown["parts"]
    assert (part["height"]["label"], part["height"]["zero"]) == (label, zero)
    assert part["on_earth"] == (here is not None)
    assert part["axes"] == ["x", "y", "z"]
