"""Reading a map folder: damage gives an error that says what to do, or a right result."""

import json
import re
import shutil
import time
from contextlib import suppress
from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import mapped_scans, read_map_folder
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.products.export.run import ExportSettings, export_map
from tests.tools.products.export.finished import finished_map

HERE = Georeference(60.0, 9.0)
FILES = ("map.ply", "graph.json", "summary.json")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_map(tmp_path_factory.mktemp("whole"), georeference=HERE)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(whole: Path, name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a folder"):
        read_map_folder(tmp_path / "map")
    shutil.copytree(whole, tmp_path / "map")
    (tmp_path / "map" / name).unlink()
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        read_map_folder(tmp_path / "map")


def test_exports_are_reproducible(whole: Path, tmp_path: Path) -> None:
    """For formats whose writers draw identifiers or note the time."""
    contents: list[dict[str, bytes]] = []
    for name in ("first", "second"):
        files = export_map(read_map_folder(whole), tmp_path / name, ExportSettings(("e57", "gpkg"))).files
        contents.append({path.name: path.read_bytes() for path in files})
        time.sleep(0.01)  # GeoPackages note milliseconds
    assert contents[0] == contents[1]


@pytest.mark.parametrize("name", ["map.ply", "graph.json", "pairs.csv"])
def test_a_file_that_differs_from_the_summary_is_named(whole: Path, name: str, tmp_path: Path) -> None:
    folder = shutil.copytree(whole, tmp_path / "map")
    content = bytearray((folder / name).read_bytes())
    if name == "pairs.csv":  # not read, so only its size is checked
        content += b"\n"
    else:
        content[-3] ^= 1
    (folder / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{re.escape(name)} does not belong to summary\.json"):
        read_map_folder(folder)


@pytest.mark.parametrize("renamed", [1, 5])
def test_a_run_killed_between_two_files_is_detected(tmp_path: Path, renamed: int) -> None:
    """Its files replace those of an earlier run one by one, summary.json last."""
    folder, replace, done = finished_map(tmp_path, split=True), Path.replace, list[Path]()

    def killed(path: Path, target: Path) -> Path:
        if len(done) == renamed:
            raise SystemExit
        done.append(target)
        return replace(path, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "replace", killed)
        with pytest.raises(SystemExit):
            finished_map(folder)
    assert folder / "summary.json" not in done
    with pytest.raises(InputError, match=r"does not belong to summary\.json"):
        read_map_folder(folder)
    read_map_folder(finished_map(folder))


STRANGE = (None, 3, "x", [], {}, [1], [{"sha256": 1}], {"inputs": [7], "frame": 5, "patch_test": 1}, True)


@pytest.mark.parametrize("name", ["settings", "components", "straightened"])
def test_values_of_wrong_types_are_refused_or_ignored(whole: Path, name: str, tmp_path: Path) -> None:
    folder = shutil.copytree(whole, tmp_path / "map")
    summary = json.loads((folder / "summary.json").read_text())
    for value in STRANGE:
        (folder / "summary.json").write_text(json.dumps({**summary, name: value}))
        for scans in ([], ["gone"]):
            with suppress(InputError):
                mapped_scans(read_map_folder(folder), scans)


def test_a_null_covariance_is_refused(whole: Path, tmp_path: Path) -> None:
    """It would make the map's uncertainty NaN."""
    folder = shutil.copytree(whole, tmp_path / "map")
    summary, graph = (json.loads((folder / name).read_text()) for name in ("summary.json", "graph.json"))
    del summary["checksums"]
    graph["poses"][3]["covariance"][4][4] = None
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "graph.json").write_text(json.dumps(graph))
    with pytest.raises(InputError, match=r"a covariance that is not finite.*map again"):
        read_map_folder(folder)


def test_coordinates_beyond_1e9_m_are_refused(whole: Path, tmp_path: Path) -> None:
    """In a map without checksums, as earlier versions wrote it."""
    folder = shutil.copytree(whole, tmp_path / "map")
    summary = json.loads((folder / "summary.json").read_text())
    del summary["checksums"]
    (folder / "summary.json").write_text(json.dumps(summary))
    part = read_map_folder(folder).parts[0]
    part.points[3, 1] = 3e223
    write_ply(folder / "map.ply", part.points, dict(part.columns))
    with pytest.raises(InputError, match="coordinates or counts that cannot be"):
        read_map_folder(folder)
