"""g2o files: round trips, GTSAM's reading of them, the published costs, and every fault by its line."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import inverse_definite
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.poses.g2o import read_g2o
from sonarmap.tools.files.writers.g2o import write_g2o
from tests.samples.places import DATA
from tests.samples.surveys import edge, random_covariance, random_transforms

GRAPHS = DATA / "graphs"
# What GTSAM's optimizer reaches from each file's own estimate: poses, edges, chi-squared before and after.
KNOWN = {
    "tinyGrid3D": (9, 11, 286.635747, 18.6278188),
    "smallGrid3D": (125, 297, 167788.667, 1035.85066),
    "sphere2500": (2500, 4949, 2611315.42, 1351.40193),
    "parking-garage": (1661, 6275, 16727.2039, 1.26838480),
}


def sample_graph(seed: int = 0) -> PoseGraph:
    """Coordinates as of a UTM zone, full covariances, loops told backward, two components, a fixed pose."""
    rng = np.random.default_rng(seed)
    T = RigidTransform.from_translation([5e5, 4.6e6, -31.25]) * random_transforms(rng, 7, 1.2, 20.0)
    pairs = [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (3, 0), (6, 4)]
    edges = tuple(
        edge(i, j, T[i].inv() * T[j], random_covariance(rng), "sequential" if j == i + 1 else "loop") for i, j in pairs
    )
    return PoseGraph(Trajectory(np.arange(7.0), T), edges, fixed=(2,))


def test_round_trip(tmp_path):
    graph = sample_graph()
    write_g2o(tmp_path / "a.g2o", graph)
    again = read_g2o(tmp_path / "a.g2o")
    before, after = graph.trajectory.T_world_sensor, again.trajectory.T_world_sensor
    np.testing.assert_array_equal(after.translation, before.translation)
    np.testing.assert_allclose(after.rotation.as_matrix(), before.rotation.as_matrix(), atol=1e-15)
    np.testing.assert_array_equal(again.trajectory.stamps, graph.trajectory.stamps)
    assert again.fixed == (2,)
    assert [(e.i, e.j, e.kind) for e in again.edges] == [(e.i, e.j, e.kind) for e in graph.edges]
    for ours, theirs in zip(again.edges, graph.edges, strict=True):
        a, b = ours.registration, theirs.registration
        np.testing.assert_array_equal(a.T_target_source.translation, b.T_target_source.translation)
        np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-12 * np.abs(b.covariance).max())


def test_gtsam_reads_the_same_noise(tmp_path):
    """Coupled, uneven noise: a swapped or transposed block would show."""
    graph = sample_graph(1)
    write_g2o(tmp_path / "a.g2o", graph)
    factors, values = gtsam.readG2o(str(tmp_path / "a.g2o"), True)
    assert factors.size() == len(graph.edges)
    for k, e in enumerate(graph.edges):
        factor = factors.at(k)
        assert isinstance(factor, gtsam.BetweenFactorPose3)
        noise = factor.noiseModel()
        assert isinstance(noise, gtsam.noiseModel.Gaussian)
        wanted = inverse_definite(e.registration.covariance)
        np.testing.assert_allclose(noise.information(), wanted, atol=1e-9 * np.abs(wanted).max())
        measured = e.registration.T_target_source.as_matrix()
        np.testing.assert_allclose(factor.measured().matrix(), measured, atol=1e-9)
    for k, matrix in enumerate(graph.trajectory.T_world_sensor.as_matrix()):
        np.testing.assert_allclose(values.atPose3(k).matrix(), matrix, atol=1e-9)


@pytest.mark.parametrize("name", sorted(KNOWN))
@pytest.mark.skipif(not GRAPHS.is_dir(), reason=f"the benchmark graphs are not at {GRAPHS}")
def test_public_graphs(name, tmp_path):
    poses, edges, before, after = KNOWN[name]
    graph = read_g2o(GRAPHS / f"{name}.g2o")
    assert (len(graph.trajectory), len(graph.edges)) == (poses, edges)
    assert len(graph.components) == 1
    write_g2o(tmp_path / "a.g2o", graph)
    solution = read_g2o(tmp_path / "a.g2o").optimize()
    assert solution.chi_squared_before == pytest.approx(before, rel=1e-8)
    assert solution.chi_squared_after == pytest.approx(after, rel=1e-8)


V0 = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1"
V1 = "VERTEX_SE3:QUAT 1 1 2 3 0.1 0.2 0.3 0.9"
UNIT = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
E01 = f"EDGE_SE3:QUAT 0 1 1 2 3 0 0 0 1 {UNIT}"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([V0, V1.replace("0.2", "nan")], "line 2 .*NaN"),
        ([V0, V1.replace("0.2", "inf")], "line 2 .*NaN or infinity"),
        ([V0, V1, E01.replace(" 3 ", " NaN ")], "line 3 .*NaN"),
        ([V0, V1.replace("0.2", "0.2x")], "line 2.*'0.2x'"),
        ([V0, V1.replace("0.2", "1_0")], "line 2.*'1_0'"),
        ([V0, V1.rsplit(" ", 1)[0]], "line 2 has 7 columns; wanted 8"),
        ([V0, V1, "", "# a comment", E01.rsplit(" ", 1)[0]], "line 5 has 29 columns; wanted 30"),
        ([V0, V1, E01 + " 1"], "line 3 has 31 columns; wanted 30"),
        ([V0, "VERTEX_SE3:QUAT"], "line 2"),
        ([V0, "VERTEX_SE2 1 2 3 4"], "line 2 .*'VERTEX_SE2'.*VERTEX_SE3:QUAT, EDGE_SE3:QUAT, EDGE_SE3_PRIOR, FIX"),
        ([V1, V0, V1], "line 3 gives vertex 1 a second time, after line 1"),
        ([V0, V1, E01.replace("0 1", "0 7", 1)], "line 3 names vertex 7"),
        ([V0, V1, E01.replace("0 1", "1 1", 1)], "line 3.*two different poses"),
        ([V0, V1.replace(" 1 1 ", " 1.5 1 ")], "line 2.*whole numbers"),
        ([V0, V1.replace(" 1 1 ", " -1 1 ")], "line 2.*whole numbers"),
        ([V0, V1, "FIX 0 3"], "line 3 names vertex 3"),
        ([V0, V1, "FIX"], "line 3"),
        ([V0, V1, E01.replace("1 0 0 0 0 0 1", "1 2 0 0 0 0 1")], "line 3.*not positive definite"),
        ([V0, V1, E01[:-1] + "0"], "line 3.*not positive definite"),
        ([V0, V1.replace("0.1 0.2 0.3 0.9", "0 0 0 0")], "line 2 .*zero quaternion"),
        ([V0, V1, E01.replace("0 0 0 1 1", "0 0 0 0 1", 1)], "line 3 .*zero quaternion"),
        ([E01.replace("0 1", "0 2", 1)], "no VERTEX_SE3:QUAT"),
        (["# nothing"], "no line but comments"),
    ],
)
def test_faults_name_their_line(lines, words, tmp_path):
    path = tmp_path / "bad.g2o"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=words) as error:
        read_g2o(path)
    assert str(path) in str(error.value)


def test_a_file_cut_anywhere_is_an_error_or_whole_lines(tmp_path):
    path = tmp_path / "cut.g2o"
    text = f"{V0}\n{V1}\n{E01}\n"
    for length in range(len(text)):
        path.write_text(text[:length])
        if length and text[length - 1] == "\n":
            assert len(read_g2o(path).trajectory) == text[:length].count("VERTEX")
        else:
            with pytest.raises(InputError):
                read_g2o(path)


def test_quaternions_are_normalized_and_vertices_sorted(tmp_path):
    path = tmp_path / "a.g2o"
    edge, first = E01.replace("0 1", "10 30", 1), V0.replace(" 0", " 10", 1)
    path.write_text(f"{edge}\nVERTEX_SE3:QUAT 30 1 2 3 0 0 2 2\n{first}\n")
    graph = read_g2o(path)
    np.testing.assert_array_equal(graph.trajectory.stamps, [10, 30])
    R = graph.trajectory.T_world_sensor.rotation.as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(R, [[0, 0, 0], [90, 0, 0]], atol=1e-12)
    assert (graph.edges[0].i, graph.edges[0].j, graph.edges[0].kind) == (0, 1, "sequential")


def test_priors_cannot_be_written(tmp_path):
    T = RigidTransform.identity(1)
    graph = PoseGraph(Trajectory(np.zeros(1), T), (edge(0, 0, T[0], np.eye(6), "prior"),))
    with pytest.raises(InputError, match="prior"):
        write_g2o(tmp_path / "a.g2o", graph)
    assert list(tmp_path.iterdir()) == []
