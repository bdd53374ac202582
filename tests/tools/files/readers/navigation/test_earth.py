"""Places on the Earth in the map's frame, against PROJ's geodesics and Snyder's formula of convergence."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod, Transformer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.csv_table import degrees
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.tools.files.readers.navigation.logs import START, read, require_words

GEOD = Geod(ellps="WGS84")
PLACES = [(60.00004, 5.9997), (-70.1, -68.3), (-17.5, 179.9995), (60.4, 5.3)]


def log(heading: str, *cells: str) -> str:
    """A row for each scan, at its time."""
    rows = "".join(f"{START + 5 * k:.0f};{cell}\n" for k, cell in enumerate(cells))
    return f"Time;{heading}\n{rows}"


@pytest.mark.parametrize("place", PLACES)
def test_distances_and_bearings_equal_the_geodesic(path: Path, place: tuple[float, float]) -> None:
    """The second fix is 400 m away at 35 degrees, the third 250 m at 160 degrees, by Karney's geodesic."""
    lon, lat, _ = GEOD.fwd([place[1]] * 3, [place[0]] * 3, [0, 35, 160], [0, 400, 250])
    text = log("Latitude;Longitude", *(f"{a:.10f};{b:.10f}" for a, b in zip(lat, lon, strict=True)))
    values, navigated, _ = read(path, text)
    origin = navigated.georeference
    assert origin is not None
    assert (origin.latitude, origin.longitude) == (round(place[0], 5), round(place[1], 5))
    x, y = (values[:, 3:5] - values[0, 3:5]).T
    np.testing.assert_allclose(np.hypot(x, y), [0, 400, 250], atol=2e-3)
    np.testing.assert_allclose(np.degrees(np.arctan2(x[1:], y[1:])), [35, 160], atol=1e-3)


@pytest.mark.parametrize("epsg", [32632, 25832, 3067])
def test_eastings_and_northings_become_positions(path: Path, epsg: int) -> None:
    """Projected by PROJ itself; the map's axes are not the grid's, whose North is 2.6 degrees off here.

    The latter two are of ETRS89, which PROJ relates to WGS84 in Europe alone.
    """
    lon, lat, _ = GEOD.fwd([12.0] * 3, [60.0] * 3, [0, 0, 90], [0, 500, 500])
    to_grid = Transformer.from_crs(4326, epsg, always_xy=True)
    easting, northing = to_grid.transform(lon, lat)
    text = log("Easting;Northing", *(f"{e:.4f};{n:.4f}" for e, n in zip(easting, northing, strict=True)))
    settings = NavigationSettings(crs=f"EPSG:{epsg}", origin=Georeference(60.0, 12.0))
    values, *_ = read(path, text, settings)
    np.testing.assert_allclose(values[:, 3:5], [[0, 0], [0, 500], [500, 0]], atol=0.02)
    assert abs(easting[1] - easting[0]) > 20  # what a shift would do


def test_depths_do_not_change_and_degrees_are_shorter_below(path: Path) -> None:
    """A fix 100 m deep, 5 km from the origin: a degree is shorter down there, by 8 cm in 5 km."""
    settings = NavigationSettings(origin=Georeference(60.0, 5.0, height=2.5))
    lon, lat, _ = GEOD.fwd(5.0, 60.0, 90.0, 5000.0)
    text = log("Lat;Lon;Depth", *[f"{lat:.9f};{lon:.9f};100"] * 3)
    values, navigated, _ = read(path, text, settings)
    np.testing.assert_allclose(values[:, 5], 100)
    np.testing.assert_allclose(values[:, 3], 5000 * (1 - 100 / 6.39e6), atol=0.01)
    assert navigated.georeference == settings.origin


@pytest.mark.parametrize(
    ("cell", "quantity", "wanted"),
    [
        ("60 23.478 N", "lat_deg", 60.3913),
        ("N60°23.478'", "lat_deg", 60.3913),
        ("60°23'28.68\"N", "lat_deg", 60.3913),
        ("060 23.478 S", "lat_deg", -60.3913),
        ("5:19.326 W", "lon_deg", -5.3221),
        ("60º23’28.68” N", "lat_deg", 60.3913),
        ("60-23,478N", "lat_deg", 60.3913),
        ("60,3913", "lat_deg", 60.3913),
        ("-0 30", "lat_deg", -0.5),
        (".5 W", "lon_deg", -0.5),
        ("0523.478 E", "lon_deg", 523.478),  # not 52 degrees and 3.478 minutes
        ("60.5 30 N", "lat_deg", np.nan),
        ("60 75.0 N", "lat_deg", np.nan),
        ("60 23.478 E", "lat_deg", np.nan),
        ("-60 23.478 N", "lat_deg", np.nan),
        ("N 60 N", "lat_deg", np.nan),
    ],
)
def test_degrees_minutes_and_seconds_are_parsed(cell: str, quantity: str, wanted: float) -> None:
    assert degrees(cell, quantity) == pytest.approx(wanted, abs=1e-9, nan_ok=True)


def test_grid_headings_are_converted_to_true_ones(path: Path) -> None:
    """The grid's North is seen by projecting two places of one meridian."""
    lat, lon = 60.3913, 5.3221
    easting, northing = Transformer.from_crs(4326, 32632, always_xy=True).transform([lon] * 2, [lat, lat + 1e-4])
    bearing = np.degrees(np.arctan2(np.diff(easting), np.diff(northing)))[0]  # of true North, by the grid
    text = log("Heading;Lat;Lon", *[f"40;{lat};{lon}"] * 3)
    values, *_ = read(path, text, NavigationSettings(heading_reference="grid"))
    np.testing.assert_allclose(values[:, 2], 40 - bearing, atol=1e-4)
    assert bearing == pytest.approx(3.2, abs=0.1)
    with pytest.raises(InputError, match="--heading-reference grid"):
        read(path, log("Heading", *["40"] * 3), NavigationSettings(heading_reference="grid"))


def test_headings_are_converted_to_the_north_of_the_origin(path: Path) -> None:
    """A vehicle 5 km East of the map's origin that keeps to the geodesic back has the origin due West of it."""
    lon, lat, back = GEOD.fwd(5.0, 65.0, 90.0, 5000.0)
    text = log("Heading;Lat;Lon", *[f"{back % 360:.6f};{lat:.9f};{lon:.9f}"] * 3)
    values, *_ = read(path, text, NavigationSettings(origin=Georeference(65.0, 5.0)))
    assert abs(back % 360 - 270) > 0.09
    np.testing.assert_allclose(values[:, 2], 270, atol=1e-3)


def test_positions_at_0_0_are_no_fixes(path: Path) -> None:
    values, _, notes = read(path, log("Lat;Lon", "0;0", "60.4;5.3", "0.0;0.000"))
    np.testing.assert_array_equal(np.isfinite(values[:, 3]), [False, True, False])
    assert any("2 rows are at 0, 0" in note for note in notes)


@pytest.mark.parametrize(
    ("heading", "cells", "settings", "words"),
    [
        ("Lat;Lon", ["60;5", "60;5", "10;5"], {}, "km from the map's origin"),
        ("Lat;Lon", ["0;0"] * 3, {}, "no row has a position"),
        ("Lat;Lon", ["60;5"] * 3, {"crs": "EPSG:32632"}, "--nav-crs has no effect"),
        ("Easting;Northing", ["5e5;6e6"] * 3, {"crs": "EPSG:4326"}, "--nav-crs EPSG:4326"),
        ("Lat;Lon", ["60;5"] * 3, {"origin": Georeference(60, 5, heading=10)}, "--origin-heading"),
        ("Lat;Lon", ["91;5"] * 3, {}, "Lat is 91"),
        ("Lat;Lon", ["60x;5"] * 3, {}, "Lat is '60x'"),
    ],
)
def test_invalid_positions_are_refused(path: Path, heading: str, cells: list[str], settings: dict, words: str) -> None:
    require_words(path, [words], read, path, log(heading, *cells), NavigationSettings(**settings))
