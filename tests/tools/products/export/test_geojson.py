"""GeoJSON by the json module and by GDAL, against places worked otherwise."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.products.export.geojson import cut_at_180, write_geojson
from sonarmap.tools.products.export.georeferenced import Georeferenced
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
    says = refused["properties"]
    assert (says["target"], says["source"], says["kept"]) == ("scan_1", "scan_4", False)
    assert says["reason"] == "contradicts"


def test_lines_are_cut_at_180(tmp_path: Path) -> None:
    layers = features_in(tmp_path, dive("180 east"))
    for feature, count in ((layers["track"][0], 8), (layers["loops"][0], 4)):
        assert feature["geometry"]["type"] == "MultiLineString"
        west, east = feature["geometry"]["coordinates"]
        assert len(west) + len(east) == count
        assert west[-1][0] == 180
        assert east[0][0] == -180
        assert west[-1][1:] == east[0][1:]
        assert all(x > 0 for x, _, _ in west)
        assert all(x < 0 for x, _, _ in east)


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


def test_a_summary_without_surveys_is_refused(tmp_path: Path) -> None:
    earth = dive()
    for wrong in ([{}] * 6, [{"survey": 0}], [{"survey": "x"}] * 6):
        with pytest.raises(InputError, match="of which survey"):
            features_in(tmp_path, with_part(earth, earth.part, summary={"scans": wrong}))


def test_loops_to_other_parts_are_left_out(tmp_path: Path) -> None:
    earth = dive()
    trajectory = earth.part.trajectory.take(range(5))
    part = replace(earth.part, scans=tuple(range(5)), trajectory=trajectory, covariances=earth.part.covariances[:5])
    assert [loop["properties"]["reason"] for loop in features_in(tmp_path, with_part(earth, part))["loops"]] == [
        "contradicts"
    ]


def test_counters_are_null(tmp_path: Path) -> None:
    layers = features_in(tmp_path, dive(stamps=np.arange(6.0)))
    assert layers["scans"][3]["properties"]["utc"] is None
    assert layers["scans"][3]["properties"]["unix_s"] is None
    assert layers["track"][0]["properties"]["first_utc"] is None


def test_gdal_reads_it(tmp_path: Path) -> None:
    raw = pytest.importorskip("pyogrio.raw")
    features_in(tmp_path, dive())
    meta, _, geometry, _ = raw.read(tmp_path / "track.geojson")
    assert meta["crs"] == "EPSG:4326"
    assert len(geometry) == 9
