"""The folder of a map, read back: damage ends in an error that names what to do, or in a right result."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.products.export.run import ExportSettings, export_map
from tests.tools.products.export.finished import COUNT, START, STEP, finished_map

HERE = Georeference(60.0, 9.0)
FILES = ("map.ply", "graph.json", "summary.json")
SETTINGS = ExportSettings(("laz", "kml"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_map(tmp_path_factory.mktemp("whole"), georeference=HERE)


def test_it_is_what_was_written(whole: Path) -> None:
    folder = read_map_folder(whole)
    (part,) = folder.parts
    assert folder.georeference == HERE
    assert folder.names == tuple(f"scan{k}" for k in range(COUNT))
    assert set(part.columns) == {"count", "seen", "sigma", "scan", "survey", "intensity"}
    np.testing.assert_array_equal(part.point_stamps, START + STEP * part.columns["scan"])
    assert not part.placed


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(whole: Path, name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a folder"):
        read_map_folder(tmp_path / "map")
    shutil.copytree(whole, tmp_path / "map")
    (tmp_path / "map" / name).unlink()
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        read_map_folder(tmp_path / "map")


@pytest.mark.parametrize(
    ("seeds", "least"), [(range(60), 20), pytest.param(range(1000, 3000), 600, marks=pytest.mark.slow)]
)
def test_damage_is_refused_or_without_effect(whole: Path, tmp_path: Path, seeds: range, least: int) -> None:
    """Bytes of one file are changed, pieces cut, doubled or exchanged."""
    folder, refused = tmp_path, 0
    shutil.copytree(whole, folder / "map")
    contents = {name: (whole / name).read_bytes() for name in FILES}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        name = FILES[seed % len(FILES)]
        content = bytearray(contents[name])
        # half of the damage where the header is, or the first rows
        reach = len(content) if seed % 2 else min(len(content), 600)
        first, last = sorted(rng.integers(0, reach, 2).tolist())
        match seed % 5:
            case 0:
                del content[first : min(last, first + 40)]
            case 1:
                del content[last:]
            case 2:
                content[first:first] = content[first : min(last, first + 200)]
            case 3:
                content[first] = int(rng.integers(32, 127))
            case _:
                for place in rng.integers(0, reach, 4).tolist():
                    content[place] = int(rng.integers(0, 256))
        (folder / "map" / name).write_bytes(content)
        try:
            export_map(read_map_folder(folder / "map"), folder / "gis", SETTINGS)
        except InputError:
            refused += 1
        (folder / "map" / name).write_bytes(contents[name])
    assert refused > least
