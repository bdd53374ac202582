"""Exported files of one map agree on positions, times and loops."""

import json
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from pyogrio.raw import read

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Map, read_map_folder
from sonarmap.tools.products.export.run import ExportSettings, export_map
from tests.samples.clutter_scans import table_of
from tests.tools.products.export.finished import finished_map

HERE = Georeference(69.9, 17.9995, height=-3.5, vertical="MSL", heading=37.0)
FORMATS = ("csv", "eiva-position", "eiva-attitude", "geojson", "gpkg", "geotiff", "kmz", "mcap", "g2o")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Map]:
    """Folder of the exports, and the map, whose stamps are Unix seconds."""
    folder = read_map_folder(finished_map(tmp_path_factory.mktemp("out"), georeference=HERE))
    export_map(folder, folder.path / "exported", ExportSettings(FORMATS))
    return folder.path / "exported", folder


def positions(out: Path) -> list[Any]:
    """Messages of /position in map.mcap."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with (out / "map.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(["/position"])]


def test_positions_and_times_agree_in_all_files(exported: tuple[Path, Map]) -> None:
    out, _ = exported
    rows = table_of(out / "poses.csv")
    degrees = np.array([[float(row["lat_deg"]), float(row["lon_deg"])] for row in rows])
    heights = np.array([float(row["height_m"]) for row in rows])
    seconds = np.array([float(row["unix_s"]) for row in rows])
    position = np.loadtxt(out / "eiva_position.txt")
    np.testing.assert_allclose(np.degrees(position[:, 1:3]), degrees, rtol=0, atol=1e-9)
    np.testing.assert_allclose(position[:, 3], -heights, rtol=0, atol=1e-4)
    features = json.loads((out / "track.geojson").read_text())["features"]
    points = np.array([f["geometry"]["coordinates"] for f in features if f["properties"]["layer"] == "scans"])
    np.testing.assert_allclose(points, np.column_stack([degrees[:, ::-1], heights]), rtol=0, atol=1e-5)
    root = ElementTree.fromstring(zipfile.ZipFile(out / "map.kmz").read("doc.kml"))
    (line,) = (element.text or "" for element in root.iterfind(".//{*}LineString/{*}coordinates"))
    places = [[float(x) for x in row.split(",")] for row in line.split()]
    np.testing.assert_allclose(places, np.column_stack([degrees[:, ::-1], heights]), rtol=0, atol=1e-4)
    ends = [element.text for element in root.iterfind(".//{*}Point/{*}coordinates")]
    assert ends == [line.split()[0], line.split()[-1]]
    fixes = positions(out)
    assert [[fix.latitude, fix.longitude] for fix in fixes] == [pytest.approx(row, abs=1e-9) for row in degrees]
    assert all(np.isnan(fix.altitude) for fix in fixes)  # heights are above mean sea level
    meta, _, geometry, columns = read(out / "track.gpkg", layer="scans")
    # pyrefly: ignore[not-iterable]
    grid = np.array([np.frombuffer(wkb[5:], "<f8") for wkb in geometry])
    expected = [[float(row[name]) for name in ("easting_m", "northing_m", "height_m")] for row in rows]
    np.testing.assert_allclose(grid, expected, rtol=0, atol=1e-4)
    assert meta["crs"] == rows[0]["crs"]
    named = dict(zip(meta["fields"], columns, strict=True))
    for times in (position[:, 0], named["unix_s"], [float(row["stamp"]) for row in table_of(out / "graph.csv")]):
        np.testing.assert_allclose(times, seconds, rtol=0, atol=1e-6)
    assert set(named["height_reference"]) == {"MSL"} == {row["height_reference"] for row in rows}


def test_exported_loops_equal_those_of_the_map(exported: tuple[Path, Map]) -> None:
    out, folder = exported
    features = json.loads((out / "track.geojson").read_text())["features"]
    loops = [f["properties"] for f in features if f["properties"]["layer"] == "loops"]
    assert len(loops) == len(folder.loops) > 0
    assert [loop["kept"] for loop in loops] == [loop.kept for loop in folder.loops]
    meta, _, _, columns = read(out / "track.gpkg", layer="loops")
    named = dict(zip(meta["fields"], columns, strict=True))
    for name in ("target", "source", "kept", "reason"):
        assert named[name].tolist() == [loop[name] for loop in loops]
    assert (out / "graph.g2o").read_bytes() == (folder.path / "graph.g2o").read_bytes()
