"""The Python interface to finished maps: write, open, export and fuse them, and read navigation."""

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import sonarmap
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT, VOXEL = 6, 0.5
TRUTH = ring_poses(COUNT, radius=4.0)
HERE = sonarmap.Georeference(60.3913, 5.3221, -2.0)
api: Any = sonarmap  # untyped, for arguments of wrong types


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of scans."""
    folder = tmp_path_factory.mktemp("scans")
    for scan in scans_of(TRUTH, reach=4.0):
        np.savez(folder / f"{scan.name}.npz", points=scan.points, stamp=scan.stamp)
    return folder


@pytest.fixture(scope="module")
def result(scans: Path) -> sonarmap.SurveyResult:
    return sonarmap.map_scans(scans, method=KnowingRegistrar(TRUTH, 1e-4 * np.eye(6)), voxel=VOXEL)


@pytest.fixture(scope="module")
def written(scans: Path, result: sonarmap.SurveyResult, tmp_path_factory: pytest.TempPathFactory) -> sonarmap.Map:
    return sonarmap.write_map(
        result, tmp_path_factory.mktemp("out") / "map", inputs=scans, georeference=HERE, report=False
    )


def test_a_map_is_written_and_opened(written: sonarmap.Map, result: sonarmap.SurveyResult) -> None:
    again = sonarmap.Map.open(str(written.path))
    assert again.names == written.names == result.names == tuple(f"scan{k}" for k in range(COUNT))
    assert again.georeference == HERE
    (part,) = again.parts
    np.testing.assert_allclose(part.points, result.maps[0].points, atol=1e-6)
    np.testing.assert_allclose(part.covariances, result.covariances, rtol=1e-9)
    apart = part.trajectory.T_world_sensor.translation - result.trajectory.T_world_sensor.translation
    assert np.abs(apart).max() < 1e-9
    names = {path.name for path in written.path.iterdir()}
    assert {"map.ply", "map.png", "trajectory.tum", "graph.g2o", "graph.json", "pairs.csv", "summary.json"} <= names
    assert "report.html" not in names
    assert "scan0" in sonarmap.write_report(written).read_text()
    assert "report.html" in json.loads((written.path / "summary.json").read_text())["files"]


def test_a_map_is_exported(written: sonarmap.Map, scans: Path, tmp_path: Path) -> None:
    exported = sonarmap.export_map(written, tmp_path / "gis", ["laz", "geotiff"], crs="EPSG:25832")
    assert [path.name for path in exported.files if path.suffix != ".json"] == ["map.laz", "grid.tif", "grid.qml"]
    assert any("`origin`" in note for note in exported.notes) or not any("--" in note for note in exported.notes)
    sonarmap.export_map(written.path, tmp_path, "laz", points="all", crs="map")
    read = sonarmap.read_scans(scans)
    assert len(laspy.read(tmp_path / "points.laz").points) == sum(len(scan.points) for scan in read)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"formats": "gtiff"}, "'gtiff'; did you mean geotiff"),
        ({"formats": "laz", "cell": -1.0}, "`cell=-1.0` cannot be used; wanted a length in meters above zero"),
        ({"formats": "laz", "height": "low"}, "`height='low'` is not known; choose one of top"),
        ({"formats": "laz", "origin": (60, 5)}, "`origin=.*wanted Georeference or None"),
    ],
)
def test_bad_exports_are_refused(written: sonarmap.Map, tmp_path: Path, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(sonarmap.InputError, match=words) as refused:
        api.export_map(written, tmp_path, **arguments)
    assert "--" not in str(refused.value)


def test_scans_are_fused_again(result: sonarmap.SurveyResult, scans: Path) -> None:
    again = sonarmap.fuse(scans, result.trajectory, VOXEL, covariances=result.covariances)
    for name in ("points", "sigma", "seen", "count", "scan"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result.maps[0], name))
    T = RigidTransform.from_translation([0.0, 0.0, 7.0]) * result.trajectory.T_world_sensor
    moved = sonarmap.fuse(sonarmap.read_scans(scans), T.as_matrix(), VOXEL, surveys=[0] * COUNT)
    assert moved.points[:, 2].mean() == pytest.approx(again.points[:, 2].mean() + 7.0, abs=0.02)
    for given, words in (
        ((scans, TRUTH[0], VOXEL), "`poses` has one for 6 scans"),
        ((scans, TRUTH[:4], VOXEL), "`poses` has 4 for 6 scans"),
        ((scans, TRUTH, 0.0), "`voxel=0.0` cannot be used"),
        ((scans, np.zeros((6, 3)), VOXEL), r"`poses` of shape \(6, 3\) are no poses"),
        ((scans, TRUTH.as_matrix() * 2 - np.eye(4), VOXEL), "are no rotations"),
        ((scans, [TRUTH], VOXEL), "wanted Trajectory or RigidTransform or ndarray"),
    ):
        with pytest.raises(sonarmap.InputError, match=words):
            api.fuse(*given)
    with pytest.raises(sonarmap.InputError, match=r"`covariances=.*wanted finite numbers of shape \(6, 6, 6\)"):
        sonarmap.fuse(scans, TRUTH, VOXEL, covariances=np.eye(6))
    for spoiled in (np.nan, -1.0):
        covariances = result.covariances.copy()
        covariances[1, 2, 2] = spoiled
        with pytest.raises(sonarmap.InputError, match="`covariances"):
            sonarmap.fuse(scans, TRUTH, VOXEL, covariances=covariances)


def test_navigation_is_read_from_python(scans: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = [f"scan{k},1.5,-2,{30 + k},60.3913,5.3221,{3 + k}" for k in range(COUNT)]
    log.write_text("\n".join(["name,roll_deg,pitch_deg,heading_deg,latitude,longitude,Z", *rows]))
    sigmas = [0.01, 0.01, 0.05, 2.0, 2.0, 0.1]
    lever = RigidTransform.from_translation([0.0, 0.0, -1.0])
    navigated = sonarmap.read_navigation(
        log, scans, sigmas=sigmas, columns={"depth_m": "Z"}, declination=0.1, T_vehicle_sensor=lever
    )
    assert navigated.georeference is not None
    assert navigated.georeference.latitude == pytest.approx(60.3913)
    for k, scan in enumerate(navigated.scans):
        assert scan.prior is not None
        np.testing.assert_allclose(scan.prior.sigmas[:3], sigmas[:3])
        assert scan.prior.T_world_sensor.translation[2] == pytest.approx(-4.0 - k, abs=0.01)
    for given, words in (
        ({"sigmas": [1.0]}, r"`sigmas=.*wanted finite numbers of shape \(6,\)"),
        ({"frame": "enz"}, "`frame` is 'enz'"),
        ({"heading_reference": "magnetic"}, "give `declination`"),
        ({"crs": "EPSG:32632", "columns": {"depth_m": "Z"}}, "`"),
        ({}, "scan0.npz: line 1 is not a CSV line"),
    ):
        with pytest.raises(sonarmap.InputError, match=words) as refused:
            api.read_navigation(log if given else scans / "scan0.npz", scans, **given)
        assert "--" not in str(refused.value)


def test_graphs_are_optimized_and_results_print_in_three_lines(
    result: sonarmap.SurveyResult, written: sonarmap.Map
) -> None:
    optimized = sonarmap.optimize(written.path / "graph.json")
    T = sonarmap.optimize(sonarmap.PoseGraph(result.trajectory, result.edges)).graph.trajectory.T_world_sensor
    np.testing.assert_allclose(optimized.graph.trajectory.T_world_sensor.as_matrix(), T.as_matrix(), atol=1e-6)
    with pytest.raises(sonarmap.InputError, match="`start='zz'` is not known; choose one of chordal, given"):
        api.optimize(optimized.graph, start="zz")
    for each in (result, written, result.maps[0], optimized, result.pairs[0].registration):
        assert len(str(each).splitlines()) == 3, str(each)
    for each in (result.solution, written):
        assert len(repr(each).splitlines()) == 1, repr(each)


def test_unusable_folders_and_arguments_are_refused(result: sonarmap.SurveyResult, tmp_path: Path) -> None:
    with pytest.raises(sonarmap.InputError, match=r"`result=None` .*wanted SurveyResult"):
        api.write_map(None, tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(sonarmap.InputError):
        sonarmap.write_map(result, tmp_path / "file")
    with pytest.raises(sonarmap.InputError, match=r"holds no map: it has no summary\.json"):
        sonarmap.Map.open(tmp_path)
    with pytest.raises(sonarmap.InputError, match="`folder=5` cannot be used"):
        api.write_report(5)
