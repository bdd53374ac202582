"""graph.json holds the whole graph and is read as written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import sonarmap
from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.trajectory import read_graph_json
from sonarmap.tools.files.writers.tables import write_json
from sonarmap.tools.products.output.folder import survey_graph
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of

COUNT = 16
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)
WORLD = RigidTransform.from_exp_coords([0, 0, 0.8, 200.0, 100.0, -9.0])
NAMES = [f"scan{k}" for k in range(COUNT)]


@pytest.fixture(scope="module")
def result() -> SurveyResult:
    """Survey with several kinds of priors, one of them wrong, odometry, loops, and a refused pair."""
    truth = ring_poses(COUNT)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, accepted=False, probability=0.1) if (i, j) == (4, 5) else given

    scans = scans_of(truth)
    sigmas = np.array([0.01, 0.01, np.inf, 0.5, 0.5, 0.1])
    for k in range(0, COUNT, 2):
        off = 40.0 if k == 6 else 0.0
        measured = RigidTransform.from_translation([off, 0, 0]) * WORLD * truth[k]
        scans[k] = replace(scans[k], prior=PosePrior(measured, sigmas))
    odometry = Odometry(np.arange(COUNT), truth, 100.0 + np.arange(COUNT))
    registrar = KnowingRegistrar(truth, COVARIANCE, spoil)
    return Mapper(registrar, 0.2, MapperSettings(LoopSettings(per_scan=1))).run(scans, odometry=odometry)


@pytest.fixture
def path(result: SurveyResult, tmp_path: Path) -> Path:
    write_json(tmp_path / "graph.json", survey_graph(result, NAMES))
    return tmp_path / "graph.json"


def test_the_graph_is_read_as_written(result: SurveyResult, path: Path) -> None:
    graph, read = result.solution.graph, read_graph_json(path)
    assert [(edge.i, edge.j, edge.kind) for edge in read.edges] == [(e.i, e.j, e.kind) for e in graph.edges]
    assert {edge.kind for edge in read.edges} == {"sequential", "odometry", "loop"}
    for ours, theirs in zip(graph.edges, read.edges, strict=True):
        np.testing.assert_array_equal(theirs.registration.covariance, ours.registration.covariance)
    assert [pose for pose, _ in read.priors] == [pose for pose, _ in graph.priors]
    np.testing.assert_array_equal(read.priors[0][1].sigmas, graph.priors[0][1].sigmas)
    np.testing.assert_array_equal(read.trajectory.stamps, 100.0 + np.arange(COUNT))
    # optimizing it again gives the map's poses
    again = sonarmap.optimize(path, start="given").graph.trajectory.T_world_sensor
    ours = result.trajectory.T_world_sensor
    np.testing.assert_allclose(again.as_matrix(), ours.as_matrix(), atol=1e-6)


def test_graph_json_holds_what_g2o_cannot(result: SurveyResult, path: Path) -> None:
    content = json.loads(path.read_text())
    assert [pose["name"] for pose in content["poses"]] == NAMES
    assert all(pose["in_world"] and pose["key_scan"] for pose in content["poses"])
    (wrong,) = content["wrong_fixes"]
    assert (wrong["pose"], wrong["kind"], wrong["sigmas"]) == (6, "position", pytest.approx(70, abs=20))
    east, north, _ = np.array(content["poses"][6]["T_world_sensor"])[:3, 3]
    assert np.hypot(wrong["place"][0] - east, wrong["place"][1] - north) > 10  # where the fix placed the sensor
    (six,) = (prior for prior in content["priors"] if prior["pose"] == 6)
    assert six["sigmas"] == [0.01, 0.01, None, None, None, 0.1]
    verdicts = {(pair["target"], pair["source"]): pair for pair in content["pairs"]}
    assert not verdicts[4, 5]["accepted"]
    assert len(verdicts) == len(result.pairs)
    assert "rotation first" in content["conventions"]["covariance"]
    crossings = [crossing for part in result.parts for crossing in part.crossings.crossings]
    assert [(row["i"], row["j"]) for row in content["crossings"]] == [(each.i, each.j) for each in crossings]
    assert [row["after_90_m"] for row in content["crossings"]] == [each.after.most for each in crossings]
    assert crossings


@pytest.mark.parametrize("text", ["[1]", "no json", '{"format": "something else"}'])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "graph.json").write_text(text)
    with pytest.raises(InputError, match=r"graph\.json"):
        read_graph_json(tmp_path / "graph.json")
    with pytest.raises(InputError, match="cannot read"):
        read_graph_json(tmp_path / "missing.json")
