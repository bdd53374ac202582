"""Exports in Rerun, CloudCompare and QGIS, where these are installed."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import rasterio
from PIL import Image

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.products.export.formats import FORMATS
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.laz import write_laz
from sonarmap.tools.products.export.mcap import write_mcap
from tests.tools.products.export.finished import cloud_of, georeferenced, program, scattered
from tests.tools.products.export.poses import dive

DRAWN = {  # topics, and what Rerun makes of them
    "/map/points": "Points3D:positions",
    "/track/points": "Points3D:positions",
    "/tf": "Transform3D:translation",
    "/pose": "InstancePoses3D:translations",
    "/position": "GeoPoints:positions",
}


def test_topics(tmp_path: Path) -> None:
    command = program("rerun", "pip install rerun-sdk")
    earth = dive()
    write_mcap(tmp_path / "map.mcap", earth.folder, earth.part, earth)

    def rerun(*words: str | Path) -> str:
        return subprocess.run([command, *words], capture_output=True, text=True, check=True).stdout

    says = rerun("mcap", "check", tmp_path / "map.mcap")
    checked = re.findall(r"^(\w+) +\d+ +\d+ +(/\S+) +(\S+)$", says, re.MULTILINE)
    assert sorted(checked) == sorted(("ok", topic, "—") for topic in [*DRAWN, "/track"])
    rerun("mcap", "convert", tmp_path / "map.mcap", "-o", tmp_path / "map.rrd")
    chunks = rerun("rrd", "print", tmp_path / "map.rrd")
    for topic, component in DRAWN.items():
        assert re.search(rf" - {topic} - data columns: \[.*{component}", chunks), topic


OPTIONS = ("-C_EXPORT_FMT", "ASC", "-PREC", "6", "-ADD_HEADER", "-NO_TIMESTAMP", "-SAVE_CLOUDS")


def made_up() -> Georeferenced:
    return georeferenced(Georeference(60.3913, 5.3221, height=-4.5), scattered())


def in_cloudcompare(path: Path) -> tuple[list[str], np.ndarray]:
    """Names of the columns that CloudCompare saves again of a cloud, and their numbers (N, k)."""
    command = program("CloudCompare", "Debian: cloudcompare")
    surroundings = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "HOME": str(path.parent)}
    asked = [command, "-SILENT", "-O", "-GLOBAL_SHIFT", "AUTO", str(path), *OPTIONS]
    said = subprocess.run(asked, capture_output=True, text=True, env=surroundings, check=False)
    if "unhandled file extension" in said.stdout + said.stderr:
        pytest.skip(f"this CloudCompare was built without a reader of {path.suffix}")
    saved = path.with_suffix(".asc")
    assert saved.exists(), said.stdout + said.stderr
    names = saved.read_text().splitlines()[0].removeprefix("//").split()
    return names, np.loadtxt(saved, skiprows=1)


def named(names: list[str], table: np.ndarray, name: str) -> np.ndarray:
    """A column by its name, in any case; CloudCompare of some versions puts words before or after it."""
    (index,) = (k for k, each in enumerate(names) if name in each.lower())
    return table[:, index]


@pytest.mark.parametrize(("kind", "columns"), [("ply", ("intensity",)), ("laz", ("sigma", "seen"))])
def test_clouds(tmp_path: Path, kind: str, columns: tuple[str, ...]) -> None:
    """Of a PLY, coordinates and strengths come by themselves; the others are chosen in CloudCompare's dialog."""
    earth, path = made_up(), tmp_path / f"map.{kind}"
    if kind == "laz":
        write_laz(path, cloud_of(earth))
    else:
        write_ply(path, earth.part.points, earth.part.columns)
    names, table = in_cloudcompare(path)
    expected = earth.projected_points if kind == "laz" else earth.part.points
    np.testing.assert_allclose(table[:, :3], expected, rtol=0, atol=1e-3)
    for name in columns:
        np.testing.assert_allclose(named(names, table, name), earth.part.columns[name], rtol=1e-5, atol=1e-5)


EARTH = dive()
CRS = "EPSG:32632"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("gis")
    for name in ("geotiff", "kmz", "csv", "geojson", "gpkg"):
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
    degrees = {"geojson", "kmz", "csv in degrees"}
    crs = {name: "EPSG:4326" if name in degrees else CRS for name in layers}
    assert {name: says["crs"] for name, says in layers.items()} == crs


def test_places_agree(layers: dict[str, Any]) -> None:
    """The KMZ has the track twice, and its ends."""
    poses = EARTH.projected_poses
    for name in ("scans", "track", "geojson", "csv", "csv in degrees"):
        np.testing.assert_allclose(layers[name]["places"], poses, rtol=0, atol=1e-3, err_msg=name)
    np.testing.assert_allclose(layers["kmz"]["places"], [*poses, *poses, poses[0], poses[-1]], rtol=0, atol=1e-3)
    assert layers["kmz"]["renderer"] == "embeddedSymbol"  # the KMZ's own colors


def test_the_grid_is_drawn_in_the_colors_of_its_heights(layers: dict[str, Any], exported: Path) -> None:
    with rasterio.open(exported / "grid.tif") as raster:
        heights, bounds = raster.read(1, masked=True), raster.bounds
    grid = layers["grid"]
    np.testing.assert_allclose(grid["edges"], bounds, rtol=0, atol=1e-3)
    assert (grid["renderer"], grid["bands"]) == ("singlebandpseudocolor", 3)
    drawn = np.asarray(Image.open(exported / "drawn.png").convert("RGB")).astype(int)[2::4, 2::4]
    here = ~np.ma.getmaskarray(heights)
    low, high = EARTH.shown_heights
    # pyrefly: ignore[missing-attribute]
    share = np.clip((heights.filled(low) - low) / (high - low), 0, 1)
    expected = (mpl.colormaps["viridis"](share)[..., :3] * 255).astype(int)
    assert np.abs(drawn - expected)[here].max() <= 6  # QGIS blends between 17 colors
    assert (drawn[~here] == 255).all()


def test_columns_have_types(layers: dict[str, Any]) -> None:
    for name, times in (
        ("scans", ["utc"]),
        ("track", ["first_utc", "last_utc"]),
        ("geojson", ["utc", "first_utc", "last_utc"]),
        ("csv", ["utc"]),
    ):
        assert {layers[name]["types"][column] for column in times} == {"datetime"}, name
    for name in ("scans", "geojson", "csv"):
        types = layers[name]["types"]
        assert types["scan"].startswith("integer")
        numbers = {types[column] for column in ("unix_s", "depth_m", "roll_deg", "heading_sigma_deg")}
        assert numbers <= {"real", "double"}
    assert layers["loops"]["types"]["kept"] == "boolean"
    assert layers["loops"]["count"] == 2
