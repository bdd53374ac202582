"""KMZ files: valid by the OGC's and Google's schemas, read by lxml and fastkml."""

import io
import zipfile
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import fastkml
import numpy as np
import pytest
from fastkml.validator import get_schema_parser
from lxml import etree
from PIL import Image

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.geotiff import write_kmz
from tests.tools.products.export.finished import START, georeferenced, scattered, timed

NAMES = {"kml": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
PLACES = [(-70.0, -60.0002), (-17.5, 179.9999)]


def document(path: Path) -> etree._Element:
    """Root of a KMZ's document, checked against the schema."""
    root = etree.fromstring(zipfile.ZipFile(path).read("doc.kml"))
    schema = get_schema_parser()
    assert schema.validate(root), schema.error_log
    return root


def texts(root: etree._Element, query: str) -> list[str]:
    return [str(element.text) for element in root.iterfind(query, NAMES)]


def written(folder: Path, earth: Georeferenced) -> Path:
    write_kmz(folder / "map.kmz", earth)
    return folder / "map.kmz"


def test_the_track_is_in_order_of_time(tmp_path: Path) -> None:
    earth = georeferenced(Georeference(60.0, 5.0), scattered(4))
    stamps = START + np.array([5.0, 0.0, 2.5, 7.625])
    root = document(written(tmp_path, timed(earth, stamps)))
    whens = [datetime.fromisoformat(text).timestamp() for text in texts(root, ".//gx:Track/kml:when")]
    np.testing.assert_allclose(whens, np.sort(stamps), atol=1e-3)
    coordinates = [row.split(",") for row in texts(root, ".//kml:LineString/kml:coordinates")[0].split()]
    assert [row.split() for row in texts(root, ".//gx:Track/gx:coord")] == [coordinates[k] for k in (1, 2, 0, 3)]


def test_fastkml_reads_the_placemarks(tmp_path: Path) -> None:
    """Without times there is no timed track; characters that XML cannot hold become question marks."""
    earth = georeferenced(Georeference(60.0, 5.0), scattered(4))
    content = zipfile.ZipFile(written(tmp_path, earth)).read("doc.kml")
    # pyrefly: ignore[missing-attribute]
    names = [feature.name for feature in fastkml.kml.KML.parse(io.BytesIO(content)).features[0].features]
    assert [name for name in names if name not in ("map", "heights")] == ["track", "track with times", "start", "end"]
    counted = timed(earth, np.arange(4.0))
    folder = replace(counted.folder, names=("<a>&\x07\udcff", *"bcd"))
    root = document(written(tmp_path, replace(counted, folder=folder)))
    assert texts(root, ".//kml:Placemark/kml:name") == ["track", "start", "end"]
    assert "&lt;a&gt;&amp;??" in texts(root, ".//kml:Placemark/kml:description")[0]


@pytest.mark.parametrize("place", PLACES)
def test_every_point_has_a_colored_pixel(place: tuple[float, float], tmp_path: Path) -> None:
    """Pixels are computed from an overlay's box and size; a map across 180 degrees has two overlays."""
    earth = georeferenced(Georeference(*place, heading=20.0), scattered(4, reach=60.0))
    path = written(tmp_path, earth)
    archive = zipfile.ZipFile(path)
    assert archive.namelist()[0] == "doc.kml"
    drawn = 0
    overlays = document(path).findall(".//kml:GroundOverlay", NAMES)
    assert len(overlays) == (2 if abs(place[1]) > 179 else 1)
    for overlay in overlays:
        (href,) = texts(overlay, "kml:Icon/kml:href")
        north, south, east, west = (float(texts(overlay, f".//kml:{e}")[0]) for e in ("north", "south", "east", "west"))
        assert -180 <= west < east <= 180
        alpha = np.array(Image.open(io.BytesIO(archive.read(href))).convert("RGBA"))[..., 3]
        row = np.floor((north - earth.points[:, 0]) / (north - south) * alpha.shape[0]).astype(int)
        column = np.floor((earth.points[:, 1] - west) / (east - west) * alpha.shape[1]).astype(int)
        inside = (row >= 0) & (row < alpha.shape[0]) & (column >= 0) & (column < alpha.shape[1])
        assert (alpha[row[inside], column[inside]] == 255).all()
        drawn += int(inside.sum())
        assert (alpha == 0).any()
    assert drawn == len(earth.points)


def test_a_kmz_is_reproducible_and_its_files_are_readable(tmp_path: Path) -> None:
    earth = georeferenced(Georeference(60.0, 5.0), scattered(2))
    path = written(tmp_path, earth)
    before = path.read_bytes()
    entries = zipfile.ZipFile(path).infolist()
    assert {entry.filename for entry in entries} == {"doc.kml", "files/map_1.png", "files/legend.png"}
    assert all(entry.external_attr >> 16 & 0o444 == 0o444 for entry in entries)
    assert before == written(tmp_path, earth).read_bytes()
