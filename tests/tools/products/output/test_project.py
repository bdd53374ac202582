"""The folder of a mapper's result: columns of the maps, layers of the surveys, and the picture."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.doubtful_points import component_maps
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.names import require_apart
from sonarmap.tools.files.readers.clouds.ply import read_ply_columns
from sonarmap.tools.products.output.folder import SurveyRun, write_survey
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT = 12
RUN = SurveyRun([f"s{k}" for k in range(COUNT)])


@pytest.fixture(scope="module")
def mapped() -> tuple[list[Scan], SurveyResult]:
    """Scans of two rounds of a ring, and their survey with every third loop refused."""
    truth = ring_poses(COUNT, turns=2)
    scans = scans_of(truth)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, accepted=False, reason="spoiled") if j - i > 1 and j % 3 == 0 else given

    return scans, Mapper(KnowingRegistrar(truth, 1e-4 * np.eye(6), spoil), 0.5).run(scans)


def as_surveys(mapped: tuple[list[Scan], SurveyResult], several: bool) -> SurveyResult:
    """The result; with `several`, the second round is another survey."""
    scans, result = mapped
    surveys = [int(several and k >= COUNT // 2) for k in range(COUNT)]
    T, covariances = result.trajectory.T_world_sensor, result.covariances
    placed_scans = PlacedScans.of(scans, T, 0.5, covariances=covariances, surveys=surveys)
    return replace(result, parts=(component_maps(placed_scans, result.chained),))


@pytest.fixture(scope="module")
def folder(mapped: tuple[list[Scan], SurveyResult], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of two surveys in one frame."""
    out = tmp_path_factory.mktemp("out")
    write_survey(out, as_surveys(mapped, several=True), RUN)
    return out


def test_every_file_is_named_in_the_summary(folder: Path) -> None:
    files = json.loads((folder / "summary.json").read_text())["files"]
    layers = {f"map{kind}" for k in (0, 1) for kind in (f"_survey_{k}.ply", f"_all_survey_{k}.ply")}
    rest = {"map.ply", "map_all.ply", "map.png", "trajectory.tum"}
    rest |= {"graph.g2o", "graph.json", "pairs.csv", "summary.json"}
    assert set(files) == layers | rest == {path.name for path in folder.iterdir()}


@pytest.mark.slow
def test_doubtful_points_are_in_the_complete_map(mapped: tuple[list[Scan], SurveyResult], tmp_path: Path) -> None:
    """Five points of the map are made doubtful."""
    _, result = mapped
    (part,) = result.parts
    whole = part.optimized
    out = np.arange(len(whole.points)) % (len(whole.points) // 5) == 2
    clean = replace(whole.take(~out), doubted=int(out.sum()))
    changed = replace(part, optimized=clean, doubtful=whole.take(out))
    write_survey(tmp_path, replace(result, parts=(changed,)), RUN)
    columns, everything = (read_ply_columns((tmp_path / name).read_bytes()) for name in ("map.ply", "map_all.ply"))
    assert set(everything) == set(columns) | {"looked", "doubtful"}
    for name, column in columns.items():
        np.testing.assert_array_equal(everything[name][everything["doubtful"] == 0], column)
    np.testing.assert_array_equal(everything["x"][everything["doubtful"] == 1], whole.points[out, 0])
    assert (everything["looked"] >= 0).all()
    (component,) = json.loads((tmp_path / "summary.json").read_text())["components"]
    assert component["map"]["seen_by_too_few"] == out.sum()
    assert component["map"]["points"] == len(columns["x"])

    (tmp_path / "map_all_3.ply").write_text("mine")  # not listed in the earlier run's summary
    write_survey(tmp_path, replace(result, parts=(replace(part, doubtful=None),)), RUN)
    assert not (tmp_path / "map_all.ply").exists()
    assert (tmp_path / "map_all_3.ply").read_text() == "mine"


def test_a_complete_map_among_the_scans_is_refused(tmp_path: Path) -> None:
    require_apart(tmp_path, [tmp_path / "all.ply", tmp_path / "map_all_scans.ply"])
    for name in ("map_all.ply", "map_all_2.ply", "map_all_survey_0.ply", "map_all_2_survey_10.ply"):
        with pytest.raises(InputError, match="is among the scans"):
            require_apart(tmp_path, [tmp_path / name])


def test_the_summary_has_crossing_errors_and_removed_points(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    crossing = summary["crossing_error_m"]
    assert crossing["pairs"] > 0
    assert 0 < crossing["after"] <= min(crossing["after_90"], crossing["before"])
    (component,) = summary["components"]
    assert component["map"]["contradicted_by_free_space"] >= 0
    assert list(component["surveys"]) == ["0", "1"]
    assert summary["unplaced"] == []


def test_the_map_has_columns_of_count_sigma_scan_and_survey(folder: Path) -> None:
    import open3d

    whole, first, second = (
        {name: values.numpy().ravel() for name, values in open3d.t.io.read_point_cloud(path).point.items()}
        for path in (folder / name for name in ("map.ply", "map_survey_0.ply", "map_survey_1.ply"))
    )
    assert {"count", "seen", "sigma", "scan", "survey"} <= set(whole)
    assert (whole["count"] >= whole["seen"]).all()
    assert ((whole["sigma"] > 0) & (whole["sigma"] < 1)).all()
    assert [set(columns["survey"]) for columns in (whole, first, second)] == [{0, 1}, {0}, {1}]
    assert set(second["scan"]) == set(range(COUNT // 2, COUNT))


@pytest.mark.slow
def test_one_survey_has_no_layers(mapped: tuple[list[Scan], SurveyResult], tmp_path: Path) -> None:
    write_survey(tmp_path, as_surveys(mapped, several=True), RUN)
    write_survey(tmp_path, as_surveys(mapped, several=False), RUN)
    assert not list(tmp_path.glob("map_survey*"))  # those of the earlier run are removed
