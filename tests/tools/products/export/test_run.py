"""Export of a finished map: side-car files, refusals, omitted parts, and writing all files or none."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from pyproj import CRS

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Map, read_map_folder
from sonarmap.tools.products.export.formats import FORMATS
from sonarmap.tools.products.export.run import ExportSettings, export_map
from tests.samples.clutter_scans import files_in
from tests.tools.products.export.finished import finished_map

HERE = Georeference(60.0, 11.9999, height=-2.0, vertical="MSL", heading=70.0)
ALL = ExportSettings(tuple(FORMATS))
PLAIN = (("map", "mcap"), ("surface", "ply"), ("surface", "glb"))
LAZ = ExportSettings(("laz",))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_map(tmp_path_factory.mktemp("one"), georeference=HERE)


@pytest.fixture(scope="module")
def split(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Map folder of two parts without a georeference."""
    return finished_map(tmp_path_factory.mktemp("two"), split=True)


def placed(folder: Path, here: Georeference = HERE) -> Map:
    return replace(read_map_folder(folder), georeference=here)


def side_car(path: Path) -> dict:
    return json.loads(path.with_name(f"{path.name}.json").read_text())


def test_every_file_has_a_side_car_that_describes_it(whole: Path, tmp_path: Path) -> None:
    exported = export_map(read_map_folder(whole), tmp_path / "gis", ALL)
    files = [path for path in exported.files if path.suffix != ".json"]
    assert set(exported.files) == set((tmp_path / "gis").iterdir())
    # `map --export` needs the names before mapping, to know what it would replace
    known = [file.format("") for each in FORMATS.values() for file in each.files]
    assert {path.name for path in exported.files} == {*known, *(f"{name}.json" for name in known)}
    for path in files:
        record = side_car(path)
        assert (record["file"], record["bytes"]) == (path.name, path.stat().st_size)
        assert record["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert {"sonarmap", "numpy", "pyproj", "laspy", "rasterio"} <= set(record["written_by"])
        assert record["inputs"] == [{"name": "scans/a.ply", "bytes": 3, "sha256": "0" * 64}]
        assert record["map"]["settings"] == {"voxel": 0.5}
        assert record["points"] == len(read_map_folder(whole).parts[0].points)
        assert record["taken"]["utc"] == ["2016-12-31T23:59:50.250000Z", "2017-01-01T00:00:07.750000Z"]
        assert "mean sea level" in record["vertical_reference"]
        assert (record["origin"]["latitude_deg"], record["origin"]["height_m"]) == (60.0, -2.0)
        assert "positive up" in record["signs"]
    assert side_car(tmp_path / "gis" / "map.laz")["crs"]["epsg"] == 32632
    assert CRS.from_wkt(side_car(tmp_path / "gis" / "grid.tif")["crs"]["wkt"]).is_compound
    assert side_car(tmp_path / "gis" / "map.kmz")["crs"]["epsg"] == 4326
    # 3 degrees from the central meridian at 60 degrees north, grid north is 3 sin 60 = 2.598 degrees east of true
    origin = side_car(tmp_path / "gis" / "map.laz")["origin"]
    assert origin["grid_convergence_deg"] == pytest.approx(2.598, abs=2e-3)
    assert origin["x_axis_grid_heading_deg"] == pytest.approx(70 - 2.598, abs=2e-3)


@pytest.mark.parametrize(
    ("here", "crs", "noted"),
    [
        (HERE, None, "more than one UTM zone"),
        (Georeference(60.0, 9.0), None, "--origin-heading"),
        (Georeference(55.0, 5.0), "EPSG:3413", "outside the area"),  # the Arctic's, north of 60 degrees
    ],
)
def test_uncertain_georeferences_are_noted(
    whole: Path, tmp_path: Path, here: Georeference, crs: str | None, noted: str
) -> None:
    assert noted in " ".join(export_map(placed(whole, here), tmp_path, ExportSettings(("laz",), crs)).notes)


def test_parts_without_a_place_are_named_and_not_written(split: Path, tmp_path: Path) -> None:
    """The user's origin places the largest part; otherwise those that instruments placed are written."""
    exported = export_map(placed(split), tmp_path / "user", LAZ)
    assert {path.name for path in exported.files} == {"map.laz", "map.laz.json"}
    assert any("map_2.ply" in note and "laz" in note for note in exported.notes)
    folder = placed(split, replace(HERE, heading=90.0))
    parts = tuple(replace(part, in_world=part.suffix == "_2") for part in folder.parts)
    exported = export_map(replace(folder, parts=parts), tmp_path, LAZ)
    assert {path.name for path in exported.files} == {"map_2.laz", "map_2.laz.json"}
    with pytest.raises(InputError, match="origin-heading"):
        export_map(replace(folder, parts=parts, georeference=HERE), tmp_path, LAZ)


def test_an_export_replaces_only_earlier_exports(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "map.laz").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"map\.laz exists and"):
        export_map(read_map_folder(whole), tmp_path, ALL)
    assert files_in(tmp_path) == {"map.laz": b"mine"}
    (tmp_path / "map.laz").unlink()
    export_map(placed(whole, replace(HERE, longitude=9.0)), tmp_path, LAZ)
    before = side_car(tmp_path / "map.laz")["sha256"]
    export_map(read_map_folder(whole), tmp_path, LAZ)
    assert side_car(tmp_path / "map.laz")["sha256"] != before


@pytest.mark.parametrize("fault", [KeyboardInterrupt(), InputError("full")])
def test_all_files_or_none(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: BaseException) -> None:
    """Stopped while the second format is written: the first is not written either, and an earlier export stays."""
    export_map(read_map_folder(whole), tmp_path, LAZ)
    before = files_in(tmp_path)

    def stop(*_: object) -> None:
        raise fault

    monkeypatch.setattr("sonarmap.tools.products.export.georeferenced.cells_of", stop)
    with pytest.raises(type(fault)):
        export_map(placed(whole, replace(HERE, longitude=9.0)), tmp_path, ExportSettings(("laz", "geotiff")))
    assert files_in(tmp_path) == before


def test_exports_in_the_map_folder_are_listed_and_removed_by_the_next_map(tmp_path: Path) -> None:
    out = finished_map(tmp_path / "out", georeference=HERE)
    before = json.loads((out / "summary.json").read_text())
    (out / "notes.txt").write_text("mine")
    export_map(read_map_folder(out), out, ExportSettings(("laz", "kmz")))
    names = ["map.laz", "map.laz.json", "map.kmz", "map.kmz.json"]
    after = json.loads((out / "summary.json").read_text())
    assert after == before | {"files": before["files"] + names}
    export_map(read_map_folder(out), out, LAZ)
    assert json.loads((out / "summary.json").read_text()) == after
    finished_map(out, georeference=HERE)
    assert {path.name for path in out.iterdir()} == {*before["files"], "notes.txt"}


def test_listed_files_that_are_not_exports_are_kept(tmp_path: Path) -> None:
    out = finished_map(tmp_path / "out")
    summary = json.loads((out / "summary.json").read_text())
    (tmp_path / "a").write_text("outside")
    (tmp_path / "a.json").write_text("outside")
    (out / "b.txt").write_text("mine")
    summary["files"] += ["../a", "../a.json", "b.txt", "..", "...json", 7]
    (out / "summary.json").write_text(json.dumps(summary))
    finished_map(out)
    assert all(path.exists() for path in (tmp_path / "a", tmp_path / "a.json", out / "b.txt"))


def test_formats_without_georeference_are_written_for_every_part(split: Path, tmp_path: Path) -> None:
    folder = read_map_folder(split)
    names = tuple(name for name in FORMATS if not FORMATS[name].needs_place)
    files = {path.name for path in export_map(folder, tmp_path, ExportSettings(names)).files}
    expected = {f"{name}{part}.{suffix}" for name, suffix in PLAIN for part in ("", "_2")} | {"graph.g2o", "graph.csv"}
    assert files == expected | {f"{name}.json" for name in expected}
