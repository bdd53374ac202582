"""Exported tables: the graph, EIVA's poses, tracks, and poses.csv against independent coordinates and signs."""

import json
import re
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.writers.poses import write_g2o
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.track import (
    COLUMNS,
    write_eiva_attitude,
    write_eiva_position,
    write_geojson,
    write_geopackage,
    write_graph,
    write_poses_csv,
)
from tests.samples.clutter_scans import table_of
from tests.tools.products.export.finished import local_of, local_of_degrees
from tests.tools.products.export.poses import PLACES, dive, floats, with_part


def two_parts(path: Path) -> Map:
    """Map with scans 1, 3, 4 in the world with times, scans 0, 5 in a second part with counters; 2 is unplaced."""
    earth = dive()
    stamps = np.array([0, 1.7e9, 9, 1.7e9 + 2.5, 1.7e9 + 5.0004, 7], dtype=np.float64)
    whole = Trajectory(stamps, earth.part.trajectory.T_world_sensor)
    parts = tuple(
        replace(earth.part, suffix=suffix, scans=scans, trajectory=whole.take(scans), in_world=in_world)
        for suffix, scans, in_world in (("", (1, 3, 4), True), ("_2", (0, 5), False))
    )
    write_g2o(path / "graph.g2o", PoseGraph(whole, ()), {2})
    return replace(with_part(earth, parts[0]).folder, path=path, parts=parts)


def test_graph_csv_has_a_row_for_each_vertex(tmp_path: Path) -> None:
    folder = two_parts(tmp_path)
    write_graph(tmp_path / "out" / "graph.csv", folder, folder.parts[0], None)
    rows = table_of(tmp_path / "out" / "graph.csv")
    second, world = ("2", "first pose"), ("1", "East-North-Up")
    assert [(row["vertex"], row["name"], row["map"], row["frame"]) for row in rows] == [
        (str(k), f"scan_{k}", *where) for k, where in ((0, second), (1, world), (3, world), (4, world), (5, second))
    ]
    assert [row["utc"] for row in rows][2:] == ["2023-11-14T22:13:22.500000Z", "2023-11-14T22:13:25.000400Z", ""]
    assert [float(row["stamp"]) for row in rows] == [0, 1.7e9, 1.7e9 + 2.5, 1.7e9 + 5.0004, 7]
    vertices = read_g2o(tmp_path / "out" / "graph.g2o").trajectory.stamps
    assert [int(row["vertex"]) for row in rows] == vertices.tolist()
    with pytest.raises(InputError, match=r"graph\.g2o: .*map again"):
        write_graph(tmp_path / "graph.csv", replace(folder, path=tmp_path / "elsewhere"), folder.parts[0], None)


def rows_of(path: Path, earth: Georeferenced) -> list[dict[str, str]]:
    write_poses_csv(path / "poses.csv", earth)
    return table_of(path / "poses.csv")


@pytest.mark.parametrize("place", PLACES)
def test_positions_equal_those_of_an_independent_conversion(tmp_path: Path, place: str) -> None:
    earth = dive(place)
    rows = rows_of(tmp_path, earth)
    written = floats(rows, "lat_deg", "lon_deg", "height_m")
    expected = earth.part.trajectory.T_world_sensor.translation
    np.testing.assert_allclose(local_of_degrees(written, earth.georeference), expected, rtol=0, atol=1e-4)
    grid = floats(rows, "easting_m", "northing_m", "height_m")
    np.testing.assert_allclose(local_of(grid, PLACES[place][1], earth.georeference), expected, rtol=0, atol=2e-4)
    np.testing.assert_allclose(floats(rows, "depth_m")[:, 0], [31.25, 30.75, 30.25, 29.75, 29.25, 28.75])
    assert {row["crs"] for row in rows} == {f"EPSG:{PLACES[place][1]}"}
    assert {row["height_reference"] for row in rows} == {"surface"}
    assert {row["heave_m"] for row in rows} == {"0.00000"}
    if place == "180 east":
        assert (written[:3, 1] > 179.999).all()
        assert (written[3:, 1] < -179.999).all()


def test_angles_have_the_signs_of_navigation_displays(tmp_path: Path) -> None:
    """Computed by hand at 60 north, 2.9995 degrees east of the zone's central meridian."""
    rows = rows_of(tmp_path, dive())
    k = np.arange(6)
    np.testing.assert_allclose(floats(rows, "roll_deg")[:, 0], 2 * k - 3, atol=1e-6)  # starboard down
    np.testing.assert_allclose(floats(rows, "pitch_deg")[:, 0], k - 7, atol=1e-6)  # the nose was down by 7 - k
    # x east of the origin is x / (R cos 60) radians of longitude, and North turns by that times sin 60
    x = 40.0 * k - 90
    turned = np.degrees(x / 6.394e6) * np.tan(np.radians(60))
    np.testing.assert_allclose(floats(rows, "heading_deg")[:, 0], 30 + 25 * k + turned, atol=1e-5)
    # tan(convergence) = tan(longitude from the middle) sin(latitude)
    longitude = np.radians(2.9995) + x / 6.394e6 / np.cos(np.radians(60))
    convergence = np.degrees(np.arctan(np.tan(longitude) * np.sin(np.radians(60))))
    np.testing.assert_allclose(floats(rows, "convergence_deg")[:, 0], convergence, atol=1e-4)
    grid = floats(rows, "heading_grid_deg")[:, 0]
    np.testing.assert_allclose(grid, 30 + 25 * k + turned - convergence, atol=2e-4)
    assert 27.39 < grid[0] < 27.41  # 30 - 2.597 - 0.001


def test_times_are_utc_and_empty_for_counters(tmp_path: Path) -> None:
    stamps = np.array([1.7e9, 1.7e9 + 0.1234567, 1_582_934_399.9994, 1.75e9, 1.75e9 + 0.001, 2e9])
    rows = rows_of(tmp_path, dive(stamps=stamps))
    for row, stamp in zip(rows, stamps, strict=True):
        assert float(row["unix_s"]) == stamp
        assert datetime.fromisoformat(row["utc"]).timestamp() == pytest.approx(stamp, abs=1e-6)
    assert rows[2]["utc"] == "2020-02-28T23:59:59.999400Z"
    for row in rows_of(tmp_path, dive(stamps=np.arange(6.0))):  # counters
        assert (row["utc"], row["unix_s"]) == ("", "")


def test_sigmas_equal_those_of_poses_drawn_from_the_covariance(tmp_path: Path) -> None:
    earth = dive()
    rng = np.random.default_rng(8)
    shape = rng.normal(size=(6, 6)) * np.array([0.01, 0.02, 0.03, 0.4, 0.2, 0.1])[:, None]
    covariance = shape @ shape.T
    part = replace(earth.part, covariances=np.tile(covariance, (6, 1, 1)))
    row = rows_of(tmp_path, with_part(earth, part))[4]
    R = earth.rotations[4]
    w, v = np.split(rng.multivariate_normal(np.zeros(6), covariance, 200_000), 2, axis=1)
    shift = R.apply(v)
    drawn = (R * Rotation.from_rotvec(w)).as_euler("ZYX", degrees=True)
    turn = R.apply(w)
    deviations = [*shift.std(axis=0), drawn[:, 2].std(), drawn[:, 1].std(), drawn[:, 0].std()]
    names = ("east_sigma_m", "north_sigma_m", "up_sigma_m", "roll_sigma_deg", "pitch_sigma_deg", "heading_sigma_deg")
    np.testing.assert_allclose(floats([row], *names)[0], deviations, rtol=0.02)
    expected = np.cov(np.hstack([shift, turn]).T)
    upper = [name for name in COLUMNS if name.startswith("cov_")]
    assert upper[0] == "cov_east_east_m2"
    assert upper[3] == "cov_east_rot_east_m_rad"
    assert upper[-1] == "cov_rot_up_rot_up_rad2"
    size = np.sqrt(np.diagonal(expected))
    scale = np.outer(size, size)[np.triu_indices(6)]
    np.testing.assert_allclose(floats([row], *upper)[0] / scale, expected[np.triu_indices(6)] / scale, atol=0.02)


def test_names_are_escaped_and_unknown_sigmas_are_empty(tmp_path: Path) -> None:
    earth = dive()
    names = ("a,b", 'said "c"', "d\ne", "\N{GREEK SMALL LETTER ALPHA};", "lone\udce9", "=1+1")
    part = replace(earth.part, covariances=np.full((6, 6, 6), np.nan))
    rows = rows_of(tmp_path, with_part(earth, part, names=names))
    assert [row["name"] for row in rows] == [*names[:2], "d e", names[3], "lone\\udce9", "'=1+1"]
    assert {rows[0][name] for name in COLUMNS if "sigma" in name or name.startswith("cov_")} == {""}


@pytest.mark.parametrize("write", [write_eiva_position, write_eiva_attitude])
def test_eiva_lines_have_the_documented_layout_in_order_of_time(tmp_path: Path, write: Callable) -> None:
    """EIVA's example: 1179179101.202228 1.134059548584164 0.1130091400934067 349.1989770603225"""
    stamps = 1.7e9 + np.array([30.0, 31, 32, 0, 1, 2])
    write(tmp_path / "poses.txt", dive(stamps=stamps))
    lines = (tmp_path / "poses.txt").read_text().splitlines()
    assert all(re.fullmatch(r"\d{10}\.\d{6}( -?\d+\.\d{5,}){3}", line) for line in lines)
    numbers = np.loadtxt(lines)
    np.testing.assert_array_equal(numbers[:, 0], np.sort(stamps))
    if write is write_eiva_position:
        assert numbers[0, 3] == 29.75  # the depth of scan 3


def features_in(path: Path, earth: Georeferenced) -> dict[str, list[dict[str, Any]]]:
    write_geojson(path / "track.geojson", earth)
    content = json.loads((path / "track.geojson").read_text("utf-8"))
    assert content["type"] == "FeatureCollection"
    layers: dict[str, list[dict[str, Any]]] = {"track": [], "scans": [], "loops": []}
    for feature in content["features"]:
        layers[feature["properties"]["layer"]].append(feature)
    return layers


def test_geojson_has_the_track_and_the_loops(tmp_path: Path) -> None:
    layers = features_in(tmp_path, dive())
    (track,) = layers["track"]
    points = [scan["geometry"]["coordinates"] for scan in layers["scans"]]
    assert track["geometry"] == {"type": "LineString", "coordinates": points}
    assert track["properties"]["last_utc"] == "2023-11-14T22:13:32.500000Z"
    kept, refused = layers["loops"]
    assert kept["geometry"]["coordinates"] == [points[0], points[5]]
    assert kept["properties"]["kept"] is True
    assert refused["geometry"]["coordinates"] == [points[1], points[4]]
    expected = {"target": "scan_1", "source": "scan_4", "kept": False, "reason": "contradicts"}
    assert refused["properties"] == expected | {"layer": "loops"}


def test_lines_continue_beyond_180_degrees(tmp_path: Path) -> None:
    track = features_in(tmp_path, dive("180 east"))["track"][0]["geometry"]["coordinates"]
    assert min(x for x, _, _ in track) > 179.99
    assert 180 < max(x for x, _, _ in track) < 180.01


def test_each_survey_has_its_track(tmp_path: Path) -> None:
    earth = dive()
    surveys = {"scans": [{"survey": number} for number in (0, 0, 0, 1, 1, 2)]}
    layers = features_in(tmp_path, with_part(earth, earth.part, summary=surveys))
    assert [track["properties"]["scan_count"] for track in layers["track"]] == [3, 2]  # a single scan is no line
    for wrong in ([{}] * 6, [{"survey": 0}], [{"survey": "x"}] * 6):
        with pytest.raises(InputError, match="lacks the surveys of the scans"):
            features_in(tmp_path, with_part(earth, earth.part, summary={"scans": wrong}))


def written(path: Path, earth: Georeferenced) -> Path:
    write_geopackage(path / "track.gpkg", earth)
    assert [file.name for file in path.iterdir()] == ["track.gpkg"]
    return path / "track.gpkg"


def test_loops_to_other_parts_are_left_out_and_counters_are_null(tmp_path: Path) -> None:
    earth = dive(stamps=np.arange(6.0))
    trajectory = earth.part.trajectory.take(range(5))
    part = replace(earth.part, scans=tuple(range(5)), trajectory=trajectory, covariances=earth.part.covariances[:5])
    layers = features_in(tmp_path, with_part(earth, part))
    assert [loop["properties"]["reason"] for loop in layers["loops"]] == ["contradicts"]
    scan = layers["scans"][3]["properties"]
    assert (scan["utc"], scan["unix_s"], layers["track"][0]["properties"]["first_utc"]) == (None, None, None)


def test_a_folder_named_like_the_geopackage_is_refused(tmp_path: Path) -> None:
    (tmp_path / "track.gpkg").mkdir()
    with pytest.raises(InputError, match="a folder of that name"):
        write_geopackage(tmp_path / "track.gpkg", dive())


def test_a_geopackage_meets_its_standard(tmp_path: Path) -> None:
    """OGC 12-128r14: requirements 2 (application id), 13 (contents), 22 (geometry columns); times of a DATETIME."""
    with sqlite3.connect(written(tmp_path, dive())) as base:
        assert base.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert base.execute("PRAGMA user_version").fetchone() == (10200,)
        assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        contents = set(base.execute("SELECT table_name, data_type, srs_id FROM gpkg_contents"))
        assert contents == {(layer, "features", 32632) for layer in ("track", "scans", "loops")}
        kinds = set(base.execute("SELECT table_name, geometry_type_name, z FROM gpkg_geometry_columns"))
        assert kinds == {("track", "LINESTRING", 1), ("scans", "POINT", 1), ("loops", "LINESTRING", 1)}
        times = [row[0] for row in base.execute("SELECT utc FROM scans")]
        assert times[:2] == ["2023-11-14T22:13:20.000Z", "2023-11-14T22:13:22.500Z"]
    base.close()
