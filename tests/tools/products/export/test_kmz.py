"""KMZ files: valid by the OGC's and Google's schemas, read by lxml and fastkml."""

import io
import zipfile
from dataclasses import replace
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
from tests.tools.products.export.finished import georeferenced, scattered, timed

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


def test_fastkml_reads_the_placemarks(tmp_path: Path) -> None:
    """Characters that XML cannot hold become question marks."""
    earth = georeferenced(Georeference(60.0, 5.0), scattered(4))
    content = zipfile.ZipFile(written(tmp_path, earth)).read("doc.kml")
    # pyrefly: ignore[missing-attribute]
    names = [feature.name for feature in fastkml.kml.KML.parse(io.BytesIO(content)).features[0].features]
    assert [name for name in names if name not in ("map", "heights")] == ["track", "start", "end"]
    counted = timed(earth, np.arange(4.0))
    folder = replace(counted.folder, names=("<a>&\x07\udcff", *"bcd"))
    root = document(written(tmp_path, replace(counted, folder=folder)))
    assert texts(root, ".//kml:Placemark/kml:name") == ["track", "start", "end"]
    assert "&lt;a&gt;&amp;??" in texts(root, ".//kml:Placemark/kml:description")[0]


@pytest.mark.parametrize("place", PLACES)
def test_every_point_has_a_colored_pixel(place: tuple[float, float], tmp_path: Path) -> None:
    """Pixels are computed from the overlay's box and size; that of a map across 180 degrees ends beyond them."""
    earth = georeferenced(Georeference(*place, heading=20.0), scattered(4, reach=60.0))
    path = written(tmp_path, earth)
    archive = zipfile.ZipFile(path)
    assert archive.namelist()[0] == "doc.kml"
    (overlay,) = etree.fromstring(archive.read("doc.kml")).findall(".//kml:GroundOverlay", NAMES)
    (href,) = texts(overlay, "kml:Icon/kml:href")
    north, south, east, west = (float(texts(overlay, f".//kml:{e}")[0]) for e in ("north", "south", "east", "west"))
    assert -180 <= west < east <= 180.01
    alpha = np.array(Image.open(io.BytesIO(archive.read(href))).convert("RGBA"))[..., 3]
    longitude = west + (earth.points[:, 1] - west) % 360
    row = np.floor((north - earth.points[:, 0]) / (north - south) * alpha.shape[0]).astype(int)
    column = np.floor((longitude - west) / (east - west) * alpha.shape[1]).astype(int)
    assert (alpha[row, column] == 255).all()
    assert (alpha == 0).any()


def test_a_kmz_is_reproducible_and_its_files_are_readable(tmp_path: Path) -> None:
    earth = georeferenced(Georeference(60.0, 5.0), scattered(2))
    path = written(tmp_path, earth)
    before = path.read_bytes()
    entries = zipfile.ZipFile(path).infolist()
    assert {entry.filename for entry in entries} == {"doc.kml", "files/map.png", "files/legend.png"}
    assert all(entry.external_attr >> 16 & 0o444 == 0o444 for entry in entries)
    assert before == written(tmp_path, earth).read_bytes()
