"""Exported point clouds, read by other programs' readers, against independently computed coordinates."""

import json
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import copclib
import laspy
import numpy as np
import pye57
import pytest
import rasterio
from pyproj import CRS

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.cell import cell_keys
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.motion.straighten import Way, straightened
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map, mapped_scans, read_map_folder
from sonarmap.tools.files.readers.scans import read_survey
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.products.export.clouds import write_copc, write_laz
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.run import ExportSettings, export_map
from sonarmap.tools.products.output.folder import SurveyRun, write_survey
from tests.samples.clutter_scans import done, refused, scan, sonarmap
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of
from tests.tools.products.export.finished import START, cloud_of, georeferenced, local_of, scattered, timed

# At borders of zones: Norway's widened 32, 180 east, and the pole's
GRIDS = [((60.0, 11.9995), 32632), ((-17.5, 179.9995), 32760), ((84.5, 12.0), 5041)]


def written(path: Path, earth: Georeferenced) -> laspy.LasData:
    write_laz(path, cloud_of(earth))
    return laspy.read(path)


@pytest.mark.parametrize(("place", "epsg"), [*GRIDS, ((60.0, 9.4), 25832)])
def test_coordinates_equal_an_independent_conversion(place: tuple[float, float], epsg: int, tmp_path: Path) -> None:
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


def test_laz_has_the_columns_of_the_map(tmp_path: Path) -> None:
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
    las = written(tmp_path / "map.laz", timed(earth, np.arange(10.0)))  # counters are written unchanged
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


def test_scan_numbers_beyond_16_bits_are_written(tmp_path: Path) -> None:
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


def test_points_of_surfaces_are_bathymetric_and_others_low_noise(tmp_path: Path) -> None:
    """A bed with stray echoes above it, in the map and in a scan; the scan also has points that the map left out. The
    scale of Web Mercator is 2 there."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0, 12, 0.2), np.arange(0, 7, 0.2)))
    bed = np.column_stack([x, y, -9 + 0.1 * x])
    strays = np.array([[2.0, 3, -4], [9, 1, -2], [5, 6, 3]])
    earth = georeferenced(Georeference(60.0, 9.1), scattered(2), points=len(bed) + len(strays))
    part = replace(earth.part, points=np.concatenate([bed, strays]))
    earth = replace(earth, part=part, projection=Projection.of(earth.georeference, "EPSG:3857"))
    las = written(tmp_path / "map.laz", earth)
    assert np.asarray(las.classification).tolist() == [40] * len(bed) + [7] * 3
    T = part.trajectory.T_world_sensor
    left_out = np.array([[20.0, 3, -7], [4, 4, -12]])
    seen = bed[::7], np.concatenate([bed[::3] + np.array([0.05, -0.1, 0.08]), strays + 0.05, left_out])
    scans = tuple(Scan(T[k].inv().apply(seen[k]).astype(np.float32)) for k in range(2))
    cloud = replace(cloud_of(earth), scans=scans)
    write_laz(tmp_path / "points.laz", cloud)
    classes = np.asarray(laspy.read(tmp_path / "points.laz").classification)
    assert classes.tolist() == [40] * (len(bed[::7]) + len(bed[::3])) + [7] * 5
    write_copc(tmp_path / "points.copc.laz", cloud)
    with laspy.CopcReader.open(str(tmp_path / "points.copc.laz")) as reader:
        assert np.bincount(np.asarray(reader.query().classification))[[7, 40]].tolist() == [5, len(classes) - 5]


HERE = Georeference(60.0, 9.0, -3.0)
ORIGIN = ("--origin", "60,9,-3")
COUNT = 4


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with scans/ and their map in map/."""
    folder = tmp_path_factory.mktemp("survey")
    for k in range(COUNT):
        points = scan(k)
        write_ply(folder / "scans" / f"scan_{k}.ply", points, {"intensity": np.linspace(0, k + 1, len(points))})
    settings = ("--grid", "64", "--map-voxel", "0.25", "--no-report", *ORIGIN)
    done(sonarmap("map", folder / "scans", "-o", folder / "map", *settings))
    return folder


def expected(survey: Path) -> tuple[np.ndarray, np.ndarray]:
    """World points and their scans, computed from the scan files and the poses in graph.json."""
    poses = json.loads((survey / "map" / "graph.json").read_text())["poses"]
    T = [np.array(pose["T_world_sensor"]) for pose in poses]
    placed = [scan(k).astype(np.float64) @ T[k][:3, :3].T + T[k][:3, 3] for k in range(COUNT)]
    return np.concatenate(placed), np.repeat(np.arange(COUNT), [len(each) for each in placed])


def test_all_points_are_exported_to_a_millimeter(survey: Path, tmp_path: Path) -> None:
    formats = "laz,copc,e57,xyz"
    done(sonarmap("export", survey / "map", "-o", tmp_path, "--format", formats, "--points", "all"))
    points, scans = expected(survey)
    las: Any = laspy.read(tmp_path / "points.laz")
    np.testing.assert_allclose(local_of(las.xyz, 32632, HERE), points, rtol=0, atol=1e-3)
    np.testing.assert_array_equal(las["scan"], scans)
    np.testing.assert_array_equal(las.gps_time, scans)  # counters are written unchanged
    assert int(las.intensity.max()) == 65_535
    with laspy.CopcReader.open(str(tmp_path / "points.copc.laz")) as reader:
        copc = reader.query()
    axes = ("X", "Y", "Z", "scan")
    np.testing.assert_array_equal(np.sort(copc.array, order=axes), np.sort(las.points.array, order=axes))
    with pye57.E57(str(tmp_path / "points.e57")) as e57:
        read = [e57.read_scan(k, intensity=True, ignore_missing_fields=True) for k in range(e57.scan_count)]
        assert e57.get_header(2)["name"].value() == "scan_2"
        places = e57.get_header(1).translation
    xyz = np.concatenate([np.column_stack([each[f"cartesian{axis}"] for axis in "XYZ"]) for each in read])
    np.testing.assert_allclose(local_of(xyz, 32632, HERE), points, rtol=0, atol=1e-4)
    assert np.concatenate([each["intensity"] for each in read]).max() == pytest.approx(COUNT)
    T = read_map_folder(survey / "map").parts[0].trajectory.T_world_sensor.translation
    np.testing.assert_allclose(local_of(places[None], 32632, HERE)[0], T[1], atol=1e-6)
    head, *_ = (tmp_path / "points.xyz").read_text().splitlines()
    assert head.removeprefix("//").split() == ["x", "y", "z", "stamp", "scan", "survey", "intensity"]
    table = np.loadtxt(tmp_path / "points.xyz", comments="/")
    np.testing.assert_allclose(local_of(table[:, :3], 32632, HERE), points, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(table[:, 4], scans)
    side_car = json.loads((tmp_path / "points.laz.json").read_text())
    assert (side_car["points"], side_car["scans"]) == (len(points), COUNT)


def same_as_fused(folder: Map, points: np.ndarray) -> bool:
    """Whether the `count` of every map point is the number of points in its voxel."""
    origin = np.floor(np.median(points, axis=0) / folder.voxel) * folder.voxel
    keys, count = np.unique(cell_keys(points, folder.voxel, origin)[0], return_counts=True)
    of_map = cell_keys(folder.parts[0].points, folder.voxel, origin)[0]
    at = np.minimum(np.searchsorted(keys, of_map), len(keys) - 1)
    return bool(((keys[at] == of_map) & (count[at] == folder.parts[0].columns["count"])).all())


def test_chosen_scans_are_exported_in_the_map_frame(survey: Path, tmp_path: Path) -> None:
    folder = read_map_folder(survey / "map")
    export_map(folder, tmp_path, ExportSettings(("xyz",), crs="map", scans=(1, 3)))
    table = np.loadtxt(tmp_path / "points.xyz", comments="/")
    points, scans = expected(survey)
    np.testing.assert_allclose(table[:, :3], points[np.isin(scans, [1, 3])], rtol=0, atol=1e-4)
    assert set(table[:, 4]) == {1, 3}
    with pytest.raises(InputError, match="have no points"):
        export_map(folder, tmp_path, ExportSettings(("xyz",), crs="map", scans=(9,)))


@pytest.mark.parametrize("change", ["gone", "longer", "fewer"])
def test_missing_or_changed_scans_are_refused(survey: Path, tmp_path: Path, change: str) -> None:
    shutil.copytree(survey / "scans", tmp_path / "scans")
    folder = read_map_folder(survey / "map")
    assert len(mapped_scans(folder, [str(tmp_path / "scans")])) == COUNT
    first = tmp_path / "scans" / "scan_0.ply"
    match change:
        case "gone":
            shutil.rmtree(tmp_path / "scans")
        case "longer":
            write_ply(first, np.concatenate([scan(0), scan(0)]))
        case _:
            first.unlink()
    options = ("--format", "laz", "--points", "all", "--scans-from", tmp_path / "scans")
    refused(sonarmap("export", survey / "map", "-o", tmp_path / "gis", *options), "--scans-from PATH")
    assert not list(tmp_path.rglob("points*"))


@pytest.mark.slow
def test_straightened_scans_are_reproduced_from_the_map(tmp_path: Path) -> None:
    """The trajectory recorded in the map gives the same points."""
    truth = ring_poses(8, radius=4.0)
    for k, each in enumerate(scans_of(truth, reach=4.0)):
        times = {"time": np.linspace(0, 0.6, len(each.points))}
        write_ply(tmp_path / "scans" / f"scan{k}.ply", each.points, times)
    read = read_survey([tmp_path / "scans"])
    result = Mapper(KnowingRegistrar(truth, 1e-4 * np.eye(6)), 0.5).run([replace(s, times=None) for s in read.scans])
    way = Way(result.trajectory, ((0, 1, 2, 3, 4, 5, 6, 7),), bent=True, turned=False)
    straight = straightened(read.scans, way.trajectory, way.runs, 0.25, way.bent)
    result = replace(result, straightened=tuple(straight.moved.tolist()), way=way)
    run = SurveyRun([each.name for each in read.scans], {"inputs": [str(tmp_path / "scans")]})
    with patch("sonarmap.tools.products.output.folder._draw_maps"):
        write_survey(tmp_path / "map", result, run)
    folder = replace(read_map_folder(tmp_path / "map"))
    with patch("sonarmap.tools.files.map_folder.folder._require_same"):
        again = mapped_scans(folder)
        for ours, theirs in zip(again, straight.scans, strict=True):
            np.testing.assert_array_equal(ours.points, theirs.points)
        assert straight.moved.min() > 0.01
        older = replace(folder, graph={**folder.graph, "straightened_by": None})
        with pytest.raises(InputError, match="map again with this version"):
            mapped_scans(older)


def test_copc_has_the_points_of_the_laz_on_several_levels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse levels cover the map; laspy, copclib and LASzip read as many points as the LAZ has."""
    monkeypatch.setattr("sonarmap.tools.products.export.clouds._CELLS", 8)
    monkeypatch.setattr("sonarmap.tools.products.export.clouds._FEW", 50)
    cloud = cloud_of(georeferenced(Georeference(60.0, 5.0), scattered(reach=30.0), points=6_000))
    write_laz(tmp_path / "map.laz", cloud)
    path = tmp_path / "map.copc.laz"
    assert write_copc(path, cloud)["points"] == 6_000
    las: Any = laspy.read(tmp_path / "map.laz")
    axes = ("X", "Y", "Z", "gps_time")
    for backend in (laspy.LazBackend.Lazrs, laspy.LazBackend.Laszip):
        read = laspy.read(path, laz_backend=backend)
        np.testing.assert_array_equal(np.sort(read.points.array, order=axes), np.sort(las.points.array, order=axes))
    assert len(copclib.FileReader(str(path)).GetAllPoints()) == 6_000
    with laspy.CopcReader.open(str(path)) as reader:
        counts = [len(reader.query(level=level)) for level in range(4)]
        (low, high) = las.xyz.min(axis=0), (las.xyz.min(axis=0) + las.xyz.max(axis=0)) / 2
        box = reader.query(laspy.copc.Bounds(low, high))
        info = reader.copc_info
    assert 8 < counts[0] < counts[1] < counts[2]
    assert len(box) == ((las.xyz >= low) & (las.xyz <= high)).all(axis=1).sum()
    assert (np.abs(las.xyz - info.center) <= info.halfsize + 1e-3).all()
    assert (info.gps_min, info.gps_max) == (las.gps_time.min(), las.gps_time.max())


def test_the_time_of_a_scan_in_e57_is_gps_time(survey: Path, tmp_path: Path) -> None:
    folder = read_map_folder(survey / "map")
    (part,) = folder.parts
    stamps = 1_483_228_800.0 + np.arange(COUNT)  # GPS time 1167264018
    part = replace(part, trajectory=replace(part.trajectory, stamps=stamps))
    settings = ExportSettings(("e57",), "map", of_scans=True, scans_from=(str(survey / "scans"),))
    export_map(replace(folder, parts=(part,)), tmp_path, settings)
    with pye57.E57(str(tmp_path / "points.e57")) as e57:
        start = e57.get_header(1)["acquisitionStart"]["dateTimeValue"].value()
    assert start == 1_167_264_018 + 1
    assert time.gmtime(stamps[0])[:3] == (2017, 1, 1)
