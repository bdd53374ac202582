"""An export in QGIS, where it is installed: layers, their places, types of their columns, and the grid's picture."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import rasterio
from PIL import Image

from sonarmap.tools.products.export.formats import FORMATS
from sonarmap.tools.products.export.grid import shown_heights
from tests.tools.products.export.poses import dive

EARTH = dive()
CRS = "EPSG:32632"
TEMPORAL = "datetime"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("gis")
    for name in ("geotiff", "kml", "kmz", "csv", "geojson", "gpkg"):
        FORMATS[name].write(out / FORMATS[name].file.format(""), EARTH.folder, EARTH.part, EARTH)
    return out


@pytest.fixture(scope="module")
def layers(exported: Path) -> dict[str, Any]:
    """What QGIS says of the files."""
    python = shutil.which("python3", path=os.defpath)  # the system's, which QGIS comes with, and not ours
    surroundings = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "HOME": str(exported), "PYTHONPATH": ""}

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        asked = [python or "python3", *words]
        return subprocess.run(asked, capture_output=True, text=True, env=surroundings, check=False)

    if python is None or run("-c", "import qgis.core").returncode:
        pytest.skip("QGIS is not installed (Debian: qgis, python3-qgis)")
    said = run(str(Path(__file__).with_name("qgis_layers.py")), str(exported), CRS)
    assert said.returncode == 0, said.stderr
    says: dict[str, Any] = json.loads(said.stdout.splitlines()[-1])
    return says


def test_all_are_layers_of_the_crs_that_they_name(layers: dict[str, Any]) -> None:
    assert {name for name, says in layers.items() if not says["valid"]} == set()
    degrees = {"geojson", "kml", "csv in degrees"}
    assert {name: says["crs"] for name, says in layers.items()} == {
        name: "EPSG:4326" if name in degrees else CRS for name in layers
    }


@pytest.mark.parametrize("name", ["scans", "track", "geojson", "csv", "csv in degrees"])
def test_places_agree(layers: dict[str, Any], name: str) -> None:
    np.testing.assert_allclose(layers[name]["places"], EARTH.projected_poses, rtol=0, atol=1e-3)


def test_the_kml_has_the_track_twice_and_its_ends(layers: dict[str, Any]) -> None:
    poses = EARTH.projected_poses
    np.testing.assert_allclose(layers["kml"]["places"], [*poses, *poses, poses[0], poses[-1]], rtol=0, atol=1e-3)
    assert layers["kml"]["renderer"] == "embeddedSymbol"  # the KML's own colors


def test_columns_have_types(layers: dict[str, Any]) -> None:
    for name, times in (
        ("scans", ["utc"]),
        ("track", ["first_utc", "last_utc"]),
        ("geojson", ["utc", "first_utc", "last_utc"]),
        ("csv", ["utc"]),
    ):
        assert {layers[name]["types"][column] for column in times} == {TEMPORAL}, name
    for name in ("scans", "geojson", "csv"):
        types = layers[name]["types"]
        assert types["scan"].startswith("integer")
        assert {types[column] for column in ("unix_s", "depth_m", "roll_deg", "heading_sigma_deg")} <= {
            "real",
            "double",
        }
    assert layers["loops"]["types"]["kept"] == "boolean"
    assert layers["loops"]["count"] == 2


def test_the_grid_is_drawn_in_the_colors_of_its_heights(layers: dict[str, Any], exported: Path) -> None:
    with rasterio.open(exported / "grid.tif") as raster:
        heights, bounds = raster.read(1, masked=True), raster.bounds
    grid = layers["grid"]
    np.testing.assert_allclose(grid["edges"], bounds, rtol=0, atol=1e-3)
    assert (grid["renderer"], grid["bands"]) == ("singlebandpseudocolor", 3)
    drawn = np.asarray(Image.open(exported / "drawn.png").convert("RGB")).astype(int)[2::4, 2::4]
    here = ~np.ma.getmaskarray(heights)
    low, high = shown_heights(EARTH)
    share = np.clip((heights.filled(low) - low) / (high - low), 0, 1)
    expected = (mpl.colormaps["viridis"](share)[..., :3] * 255).astype(int)
    assert np.abs(drawn - expected)[here].max() <= 6  # QGIS blends between 17 colors
    assert (drawn[~here] == 255).all()
