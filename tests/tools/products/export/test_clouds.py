"""The clouds of an export as LAZ: read by other programs' readers, places worked by hand."""

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from pyproj import CRS

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.products.export.clouds import write_laz
from sonarmap.tools.products.export.georeferenced import Georeferenced
from tests.tools.products.export.finished import START, cloud_of, georeferenced, local_of, scattered, timed

# At borders of zones: Norway's widened 32, 180 east, and the pole's
GRIDS = [((60.0, 11.9995), 32632), ((-17.5, 179.9995), 32760), ((84.5, 12.0), 5041)]


def written(path: Path, earth: Georeferenced) -> laspy.LasData:
    write_laz(path, cloud_of(earth))
    return laspy.read(path)


@pytest.mark.parametrize(("place", "epsg"), [*GRIDS, ((60.0, 9.4), 25832)])
def test_coordinates_are_those_of_a_second_way(place: tuple[float, float], epsg: int, tmp_path: Path) -> None:
    """In the UTM zone, and in the CRS that the user names."""
    here = Georeference(*place, height=-3.75, heading=37.0)
    earth = replace(georeferenced(here, scattered()), projection=Projection.of(here, f"EPSG:{epsg}"))
    if epsg != 25832:
        assert Projection.of(here).name == earth.projection.name
    las = written(tmp_path / "map.laz", earth)
    np.testing.assert_allclose(local_of(las.xyz, epsg, here), earth.part.points, atol=1e-3)
    crs = las.header.parse_crs()
    assert crs is not None
    assert crs.to_epsg() == epsg


def test_dimensions(tmp_path: Path) -> None:
    earth = georeferenced(Georeference(60.0, 5.0), scattered(), points=800)
    columns = dict(earth.part.columns)
    columns["scan"] = np.arange(800, dtype=np.int32) % 5
    columns["intensity"][3] = np.nan
    las = written(tmp_path / "map.laz", replace(earth, part=replace(earth.part, columns=columns)))
    again = laspy.read(tmp_path / "map.laz", laz_backend=laspy.LazBackend.Laszip)
    assert (again.points.array == las.points.array).all()
    assert (las.header.version.major, las.header.version.minor, las.header.point_format.id) == (1, 4, 6)
    extra = {dimension.name: dimension.dtype for dimension in las.point_format.extra_dimensions}
    assert extra == {name: np.dtype(kind) for name, kind in zip(extra, ("f4", "u4", "u2", "u4"), strict=True)}
    for name in ("sigma", "count", "seen", "scan"):
        np.testing.assert_array_equal(np.asarray(las[name]), columns[name])
    np.testing.assert_array_equal(las.point_source_id, columns["scan"])
    strongest = float(np.nanmax(columns["intensity"]))
    assert las.intensity[3] == 0
    expected = np.nan_to_num(columns["intensity"]) * 65535 / strongest
    np.testing.assert_allclose(np.asarray(las.intensity), expected, atol=0.51)
    assert repr(65535 / strongest) in write_laz(tmp_path / "map.laz", cloud_of(earth))["intensity"]
    assert (np.array([las.return_number, las.number_of_returns]) == 1).all()
    np.testing.assert_array_equal(las.header.scales, 0.001)
    assert (np.abs(las.header.offsets - las.header.mins) <= 1).all()


def test_times_are_gps_times_across_a_leap_second(tmp_path: Path) -> None:
    """GPS time 1167264018 is 2017-01-01T00:00:00Z, 18 s ahead; the second before it is a leap second."""
    earth = georeferenced(Georeference(60.0, 5.0), scattered(10))
    stamps = START + 2.5 * np.arange(10)
    las = written(tmp_path / "map.laz", timed(earth, stamps))
    midnight = 1_483_228_800
    of_scan = [s - midnight + 1_167_264_018 - (1 if s < midnight else 0) - 1e9 for s in stamps.tolist()]
    np.testing.assert_allclose(np.asarray(las.gps_time), np.array(of_scan)[earth.part.columns["scan"]], atol=1e-3)
    assert las.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
    las = written(tmp_path / "map.laz", timed(earth, np.arange(10.0)))  # stamps that are no times stay as they are
    np.testing.assert_array_equal(las.gps_time, earth.part.columns["scan"])
    assert las.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.WEEK_TIME


@pytest.mark.parametrize(("vertical", "epsg"), [("surface", None), ("MSL", 5714), ("ellipsoid", None)])
def test_the_crs_names_the_vertical_reference(vertical: str, epsg: int | None, tmp_path: Path) -> None:
    las = written(tmp_path / "map.laz", georeferenced(Georeference(60.0, 9.0, vertical=vertical), scattered()))
    assert las.header.global_encoding.wkt
    (record,) = [vlr for vlr in las.header.vlrs if vlr.record_id == 2112]
    content = record.record_data_bytes()
    assert content.endswith(b"\0")
    wkt = content.rstrip(b"\0").decode()
    assert wkt.startswith(("PROJCS[", "COMPD_CS["))  # WKT 1, as the standard wants it
    crs = CRS.from_wkt(wkt)
    if epsg:
        assert [part.to_epsg() for part in crs.sub_crs_list] == [32632, epsg]
    else:
        assert crs.to_2d().to_epsg() == 32632
    assert len(crs.axis_info) == (2 if vertical == "surface" else 3)
    assert rasterio.CRS.from_wkt(wkt).is_projected  # GDAL's own reading


def test_several_surveys_and_many_scans(tmp_path: Path) -> None:
    earth = georeferenced(Georeference(60.0, 5.0), scattered(), points=300)
    many = np.arange(300, dtype=np.int32) + 65_500
    columns = {**earth.part.columns, "survey": (many % 3).astype(np.int32), "scan": many}
    columns["seen"] = np.full(300, 70_000, np.int32)  # more than its 16 bits hold
    trajectory = earth.part.trajectory.take([0] * 300)
    part = replace(earth.part, columns=columns, scans=tuple(many.tolist()), trajectory=trajectory)
    las = written(tmp_path / "map.laz", replace(earth, part=part))
    np.testing.assert_array_equal(np.asarray(las["survey"]), many % 3)
    np.testing.assert_array_equal(np.asarray(las["scan"]), many)
    np.testing.assert_array_equal(las.point_source_id, many % 65_536)
    assert (np.asarray(las["seen"]) == 65_535).all()
