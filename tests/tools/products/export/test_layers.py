"""GeoJSON and GeoPackage against places worked otherwise, read by json, sqlite3 and GDAL."""

import json
import sqlite3
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.track import cut_at_180, write_geojson, write_geopackage
from tests.tools.products.export.poses import dive, with_part


def features_in(path: Path, earth: Georeferenced) -> dict[str, list[dict[str, Any]]]:
    write_geojson(path / "track.geojson", earth)
    content = json.loads((path / "track.geojson").read_text("utf-8"))
    assert content["type"] == "FeatureCollection"
    layers: dict[str, list[dict[str, Any]]] = {"track": [], "scans": [], "loops": []}
    for feature in content["features"]:
        layers[feature["properties"]["layer"]].append(feature)
    return layers


def test_track_and_loops(tmp_path: Path) -> None:
    layers = features_in(tmp_path, dive())
    (track,) = layers["track"]
    points = [scan["geometry"]["coordinates"] for scan in layers["scans"]]
    assert track["geometry"] == {"type": "LineString", "coordinates": points}
    assert track["properties"]["last_utc"] == "2023-11-14T22:13:32.500000Z"
    kept, refused = layers["loops"]
    assert kept["geometry"]["coordinates"] == [points[0], points[5]]
    assert kept["properties"]["kept"] is True
    assert refused["geometry"]["coordinates"] == [points[1], points[4]]
    expected = {"target": "scan_1", "source": "scan_4", "kept": False, "reason": "contradicts"}
    assert refused["properties"] == expected | {"layer": "loops"}


def test_lines_are_cut_at_180(tmp_path: Path) -> None:
    layers = features_in(tmp_path, dive("180 east"))
    for feature, count in ((layers["track"][0], 8), (layers["loops"][0], 4)):
        assert feature["geometry"]["type"] == "MultiLineString"
        west, east = feature["geometry"]["coordinates"]
        assert len(west) + len(east) == count
        assert (west[-1][0], east[0][0], west[-1][1:]) == (180, -180, east[0][1:])
        assert max(x for x, _, _ in east) < 0 < min(x for x, _, _ in west)


def test_a_cut_lies_where_the_line_crosses() -> None:
    """A third of the way: by hand."""
    west, east = cut_at_180(np.array([[-179.9, 10.0, 3.0], [179.8, 13.0, 6.0]]))
    np.testing.assert_allclose(west, [[-179.9, 10, 3], [-180, 11, 4]])
    np.testing.assert_allclose(east, [[180, 11, 4], [179.8, 13, 6]])
    two = cut_at_180(np.array([[180.0, 1.0, 0.0], [-180.0, 2.0, 0.0], [-179.0, 3.0, 0.0]]))
    assert all(np.isfinite(piece).all() for piece in two)


def test_each_survey_has_its_track(tmp_path: Path) -> None:
    earth = dive()
    surveys = {"scans": [{"survey": number} for number in (0, 0, 0, 1, 1, 2)]}
    layers = features_in(tmp_path, with_part(earth, earth.part, summary=surveys))
    assert [track["properties"]["scan_count"] for track in layers["track"]] == [3, 2]  # a single scan is no line
    for wrong in ([{}] * 6, [{"survey": 0}], [{"survey": "x"}] * 6):
        with pytest.raises(InputError, match="which survey each scan"):
            features_in(tmp_path, with_part(earth, earth.part, summary={"scans": wrong}))


def written(path: Path, earth: Georeferenced) -> Path:
    write_geopackage(path / "track.gpkg", earth)
    assert [file.name for file in path.iterdir()] == ["track.gpkg"]
    return path / "track.gpkg"


def read(path: Path, layer: str) -> tuple[list[np.ndarray], dict[str, np.ndarray]]:
    """Places and attributes of a layer."""
    from pyogrio.raw import read

    meta, _, geometry, columns = read(path, layer=layer, datetime_as_string=True)
    # pyrefly: ignore[not-iterable]
    return [places(wkb) for wkb in geometry], dict(zip(meta["fields"], columns, strict=True))


def places(wkb: bytes) -> np.ndarray:
    """(n, 3) of ISO or EWKB points and lines."""
    order, kind = struct.unpack_from("<BI", wkb)
    assert order == 1
    start = 5 if kind in (1001, 0x80000001) else 9
    return np.frombuffer(wkb[start:], "<f8").reshape(-1, 3)


def test_track_and_loops_in_a_geopackage(tmp_path: Path) -> None:
    path = written(tmp_path, dive())
    points = np.vstack(read(path, "scans")[0])
    (track,), says = read(path, "track")
    np.testing.assert_array_equal(track, points)
    assert says["scan_count"][0] == 6
    (kept, refused), says = read(path, "loops")
    np.testing.assert_array_equal(kept, points[[0, 5]])
    np.testing.assert_array_equal(refused, points[[1, 4]])
    assert says["kept"].tolist() == [True, False]
    assert says["reason"].tolist() == ["ok", "contradicts"]
    assert says["source"].tolist() == ["scan_5", "scan_4"]


def test_loops_to_other_parts_are_left_out_and_counters_are_null(tmp_path: Path) -> None:
    earth = dive(stamps=np.arange(6.0))
    trajectory = earth.part.trajectory.take(range(5))
    part = replace(earth.part, scans=tuple(range(5)), trajectory=trajectory, covariances=earth.part.covariances[:5])
    layers = features_in(tmp_path, with_part(earth, part))
    assert [loop["properties"]["reason"] for loop in layers["loops"]] == ["contradicts"]
    says = layers["scans"][3]["properties"]
    assert (says["utc"], says["unix_s"], layers["track"][0]["properties"]["first_utc"]) == (None, None, None)


def test_a_folder_of_that_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "track.gpkg").mkdir()
    with pytest.raises(InputError, match="a folder of that name"):
        write_geopackage(tmp_path / "track.gpkg", dive())


def test_it_is_a_geopackage_by_its_own_words(tmp_path: Path) -> None:
    """OGC 12-128r14: requirements 2 (application id), 13 (contents), 22 (geometry columns); times of a DATETIME."""
    with sqlite3.connect(written(tmp_path, dive())) as base:
        assert base.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert base.execute("PRAGMA user_version").fetchone() == (10200,)
        assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        contents = set(base.execute("SELECT table_name, data_type, srs_id FROM gpkg_contents"))
        assert contents == {(layer, "features", 32632) for layer in ("track", "scans", "loops")}
        kinds = set(base.execute("SELECT table_name, geometry_type_name, z FROM gpkg_geometry_columns"))
        assert kinds == {("track", "LINESTRING", 1), ("scans", "POINT", 1), ("loops", "LINESTRING", 1)}
        times = [row[0] for row in base.execute("SELECT utc FROM scans")]
        assert times[:2] == ["2023-11-14T22:13:20.000Z", "2023-11-14T22:13:22.500Z"]
    base.close()
