"""Contours on a slope, and areas that cut maps out, against the equations of both."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from pyogrio.raw import read

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.products.export.clip import read_clip
from sonarmap.tools.products.export.contours import contours_of
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.kml import KML, write_kml
from sonarmap.tools.products.export.track_features import write_geojson, write_geopackage
from tests.tools.products.export.finished import georeferenced, scattered

HERE = Georeference(60.0, 9.0, -2.0)


@pytest.fixture(scope="module")
def slope() -> Georeferenced:
    """A bed that rises to the east by a tenth, 40 m square, with a hole 10 m square, and contours each half meter."""
    earth = georeferenced(HERE, scattered(3, reach=15.0), points=80 * 80)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(80) / 2 - 19.75, np.arange(80) / 2 - 19.75))
    part = replace(earth.part, points=np.column_stack([x, y, 0.1 * x - 6.03]))
    hole = (np.abs(part.points[:, :2]) < 5).all(axis=1)
    columns = {name: column[~hole] for name, column in part.columns.items()}
    part = replace(part, points=part.points[~hole], columns=columns)
    return replace(earth, part=part, cell=1.0, contours=0.5)


def test_contours_lie_on_the_slope_at_round_heights_and_not_in_the_hole(slope: Georeferenced) -> None:
    lines = contours_of(slope)
    heights = sorted({float(height) for line in lines for height in np.unique(line[:, 2])})
    # the bed is from -10.005 to -6.055, the origin's height with it
    assert heights == [-10.0, -9.5, -9.0, -8.5, -8.0, -7.5, -7.0, -6.5]
    places = np.concatenate([slope.georeference.local(slope.projection.unproject(line)) for line in lines])
    # a cell's mean is that of points on both sides of its middle
    np.testing.assert_allclose(places[:, 0], (np.concatenate(lines)[:, 2] + 2 + 6.03) / 0.1, atol=0.6)
    assert not (np.abs(places[:, :2]) < 4).all(axis=1).any()
    assert contours_of(replace(slope, contours=None)) == []
    with pytest.raises(InputError, match="--contours M"):
        contours_of(replace(slope, contours=1e-5))


def test_files_of_lines_have_them(slope: Georeferenced, tmp_path: Path) -> None:
    lines = contours_of(slope)
    write_geojson(tmp_path / "track.geojson", slope)
    features = json.loads((tmp_path / "track.geojson").read_text())["features"]
    found = [each for each in features if each["properties"]["layer"] == "contours"]
    assert len(found) == len(lines)
    first = np.array(found[0]["geometry"]["coordinates"])
    np.testing.assert_allclose(slope.projection.project(first[:, [1, 0, 2]]), lines[0], rtol=0, atol=1e-3)
    assert found[0]["properties"] == {
        "layer": "contours",
        "height_m": -10.0,
        "depth_m": 10.0,
        "height_reference": "surface",
    }
    write_geopackage(tmp_path / "track.gpkg", slope)
    info, _, geometry, (heights, *_) = read(tmp_path / "track.gpkg", layer="contours")
    assert info["geometry_type"] == "LineString Z"
    assert (len(geometry), heights.tolist()) == (len(lines), [line[0, 2] for line in lines])
    write_kml(tmp_path / "map.kml", slope)
    (folder,) = ElementTree.parse(tmp_path / "map.kml").iter(f"{{{KML}}}Folder")
    assert len(list(folder.iter(f"{{{KML}}}LineString"))) == len(lines)


def polygon(*rings: list[list[float]], **more: Any) -> str:
    return json.dumps({"type": "Polygon", "coordinates": rings, **more})


def square(half: float, here: Georeference | None = None) -> list[list[float]]:
    """Corners at so many meters from the origin, in longitude and latitude where that is on the Earth."""
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]], np.float64)
    return (corners[:, :2] if here is None else here.geodetic(corners)[:, [1, 0]]).tolist()


@pytest.mark.parametrize("here", [None, Georeference(-17.0, 180.0, heading=70.0)])
def test_polygons_have_holes_and_may_be_several(here: Georeference | None, tmp_path: Path) -> None:
    """Across the 180th meridian too."""
    points = np.random.default_rng(1).uniform(-30, 30, (2000, 3))
    path = tmp_path / "area.geojson"
    path.write_text(polygon(square(20, here), square(10, here)))
    reach = np.abs(points[:, :2]).max(axis=1)
    np.testing.assert_array_equal(read_clip(str(path), here, None).inside(points), (reach < 20) & (reach > 10))
    features = [{"type": "Feature", "geometry": json.loads(polygon(square(half, here)))} for half in (20, 5)]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    np.testing.assert_array_equal(read_clip(str(path), here, None).inside(points), reach < 20)


def test_a_box_is_in_degrees_or_projected_or_of_the_map() -> None:
    points = np.random.default_rng(1).uniform(-30, 30, (2000, 3))
    geodetic = HERE.geodetic(points)
    projected = Projection.of(HERE).project(geodetic)
    middle = np.median(projected, axis=0)
    for text, places, low, high in (
        ("8.9999,59.9999,9.0001,60.0002", geodetic[:, [1, 0]], [8.9999, 59.9999], [9.0001, 60.0002]),
        (
            ",".join(f"{m + d:.3f}" for d in (-9, 9) for m in middle[:2]),
            projected[:, :2],
            middle[:2] - 9,
            middle[:2] + 9,
        ),
    ):
        wanted = ((places > np.round(low, 4)) & (places < np.round(high, 4))).all(axis=1)
        assert 20 < wanted.sum() < 1500
        assert (read_clip(text, HERE, None).inside(points) == wanted).mean() > 0.999
    np.testing.assert_array_equal(
        read_clip("-9,-8,7,6", HERE, "map").inside(points),
        ((points[:, :2] > [-9, -8]) & (points[:, :2] < [7, 6])).all(axis=1),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2,3", "W,S,E,N"),
        ("3,2,1,4", "W below E"),
        ("none.geojson", "none.geojson"),
        (polygon(square(1), crs={"type": "name", "properties": {"name": "EPSG:25832"}}), "EPSG:25832; save it"),
        ('{"features": 3}', "no polygon"),
    ],
)
def test_what_is_no_area_is_refused(text: str, words: str, tmp_path: Path) -> None:
    if text[0] in "{[":
        (tmp_path / "area.geojson").write_text(text)
        text = str(tmp_path / "area.geojson")
    with pytest.raises(InputError, match=words):
        read_clip(text, None, None)
