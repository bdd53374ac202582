"""Places on the Earth against PROJ's geodesics, UTM's own definition, and laws."""

import numpy as np
import pytest
from pyproj import Geod, Transformer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference, Projection, on_the_earth, utm_epsg
from tests.samples.refusals import refuses

GEOD = Geod(ellps="WGS84")
PLACES = [(60.0, 5.9999), (-70.1, -68.3), (-17.5, 179.9995), (89.0, 40.0)]


@pytest.mark.parametrize("place", PLACES)
def test_local_is_the_inverse_of_geodetic(place: tuple[float, float]) -> None:
    here = Georeference(*place, height=-3.25, heading=37.5)
    points = np.random.default_rng(1).uniform(-900, 900, (200, 3)) * [1, 1, 0.1]
    np.testing.assert_allclose(here.local(here.geodetic(points)), points, atol=1e-6)


@pytest.mark.parametrize("place", PLACES)
def test_distances_and_bearings_equal_the_geodesic(place: tuple[float, float]) -> None:
    """At height 0 a point 600 m away, by Karney's geodesic, which this code does not use."""
    here = Georeference(*place, heading=30.0)
    points = np.array([[600.0, 0, 0], [0, 600.0, 0], [-300.0, 519.615242270663, 0]])
    latitude, longitude, _ = here.geodetic(points).T
    bearing, _, way = GEOD.inv([place[1]] * 3, [place[0]] * 3, longitude, latitude)
    np.testing.assert_allclose(way, 600.0, atol=1e-4)
    np.testing.assert_allclose((np.array(bearing) - [30.0, -60.0, -90.0] + 180) % 360 - 180, 0, atol=1e-5)


@pytest.mark.parametrize(
    ("place", "epsg"),
    [
        ((59.91, 10.75), 32632),
        ((60.39, 5.32), 32632),  # Bergen lies in 32V, which is widened
        ((78.22, 15.65), 32633),  # Longyearbyen
        ((-33.86, 151.2), 32756),
        ((10.0, 180.0), 32601),
        ((85.0, 3.0), 5041),
    ],
)
def test_utm_zones_follow_their_exceptions(place: tuple[float, float], epsg: int) -> None:
    assert utm_epsg(*place) == epsg


def test_a_map_across_a_border_of_zones_stays_in_one() -> None:
    here = Georeference(60.0, 11.9995)
    projection = Projection.of(here)
    across = here.geodetic(np.array([[-300.0, 0, 0], [300.0, 0, 0]]))
    assert projection.name == "EPSG:32632"
    assert projection.crosses_zone(across)
    assert not projection.crosses_zone(across[:1])
    # what a shift would do: 2.6 degrees over 300 m
    east, north, _ = (projection.project(across)[1] - projection.project(across)[0]).T
    assert 25 < abs(north) < 30
    assert east == pytest.approx(600, abs=1)


@pytest.mark.parametrize("wrong", ["EPSG:4326", "EPSG:999999", "EPSG:2263", "EPSG:5773", "nonsense"])
def test_a_crs_that_is_not_projected_in_meters_is_refused(wrong: str) -> None:
    refuses(r"--crs .*wanted", Projection.of, Georeference(40.7, -74.0), wrong)


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:3006", "EPSG:2193", "EPSG:5041", "EPSG:28992", "EPSG:31256"])
def test_eastings_and_northings_become_positions(crs: str) -> None:
    """Easting first, also where the CRS has it last: 3006 and 2193. Bergen lies beyond the area of 32632."""
    at = {"EPSG:32632": (60.3913, 5.3221), "EPSG:2193": (-41.3, 174.8), "EPSG:5041": (85.0, 100.0)}
    lat, lon = at.get(crs, (59.3, 18.0) if crs == "EPSG:3006" else (52.2, 5.4) if crs == "EPSG:28992" else (48.2, 16.4))
    to_crs = Transformer.from_crs(4326, crs, always_xy=True, allow_ballpark=False, only_best=True)
    easting, northing = to_crs.transform(lon, lat)
    place = on_the_earth(np.array([[easting, northing, -2.5]]), crs, "--origin")
    np.testing.assert_allclose(place, [[lat, lon, -2.5]], atol=1e-8)


@pytest.mark.parametrize(
    ("crs", "easting", "northing", "words"),
    [
        ("EPSG:32632", 6_700_600, 297_400, "not in the area .*easting first"),
        ("EPSG:28992", 463_000, 155_000, "not in the area .*easting first"),  # within 10 degrees
        ("EPSG:4326", 5.3, 60.4, "degrees without a CRS, as 60.3913,5.3221"),
        ("EPSG:99999", 1, 2, "does not know this CRS .*wanted a CRS as EPSG:32632:E,N"),
        ("EPSG:27700", 530_000, 180_000, "needs PROJ's grid"),
        ("EPSG:2263", 1, 2, "wanted a projected one in meters"),
    ],
)
def test_impossible_eastings_and_northings_are_refused(crs: str, easting: float, northing: float, words: str) -> None:
    refuses(f"--origin.*{words}", on_the_earth, np.array([[easting, northing, 0.0]]), crs, "--origin")


@pytest.mark.parametrize(
    "crs",
    [
        'LOCAL_CS["pool",UNIT["metre",1]]',
        "+proj=tmerc +lon_0=9 +ellps=bessel +units=m",
        "+proj=utm +zone=32 +ellps=GRS80",
    ],
)
def test_a_crs_without_a_datum_is_refused(crs: str) -> None:
    refuses("--crs .* without a datum.*--crs map", Projection.of, Georeference(60.0, 9.0), crs)
    refuses("--origin .* without a datum", on_the_earth, np.array([[3.0, 4.0, 0.0]]), crs, "--origin")


@pytest.mark.parametrize("wrong", [(91.0, 5.0), (5.0, 181.0), (np.nan, 0.0), (1.0, 2.0, np.inf), (1, 2, 3, "geoid")])
def test_an_invalid_origin_is_refused(wrong: tuple) -> None:
    refuses("wanted", Georeference, *wrong)


def test_json_round_trip() -> None:
    here = Georeference(-33.0, 151.25, 2.5, "EGM2008", 12.0)
    assert Georeference.of_json(here.to_json()) == here
    with pytest.raises(InputError):
        Georeference.of_json({"lat": 1.0})


def test_points_farther_than_200_km_are_refused() -> None:
    here = Georeference(10.0, 10.0)
    for convert, point in ((here.geodetic, [3e5, 0, 0]), (here.local, [20, 10, 0]), (here.geodetic, [np.nan, 0, 0])):
        refuses("200 km", convert, np.array([point], float))


def test_heights_follow_the_surface() -> None:
    here = Georeference(60.0, 5.0, height=2.0, vertical="MSL")
    assert here.geodetic(np.array([[5000.0, -3000.0, -41.5]]))[0, 2] == pytest.approx(-39.5, abs=1e-9)
