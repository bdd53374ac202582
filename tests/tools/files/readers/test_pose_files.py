"""TUM, KITTI, gt.log, g2o, and summary.json: round trips to the last bit, and faults by their line."""

from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import inverse_definite
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.readers.trajectory import read_gt_log, read_kitti, read_tum
from sonarmap.tools.files.writers.poses import write_g2o, write_tum
from sonarmap.tools.files.writers.tables import to_json
from tests.samples.places import DATA
from tests.samples.refusals import refuses
from tests.samples.surveys import edge, random_covariance, random_transforms


def sample() -> Trajectory:
    """Epoch seconds with microseconds, coordinates as of a UTM zone."""
    rng = np.random.default_rng(0)
    T = RigidTransform.from_translation([5e5, 4.6e6, -31.25]) * random_transforms(rng, 50, 1.2, 20.0)
    return Trajectory(1_763_700_000 + np.cumsum(rng.integers(1, 10**7, 50)) * 1e-6, T)


def test_a_tum_trajectory_is_read_back_exactly(tmp_path):
    trajectory, path = sample(), tmp_path / "a.tum"
    write_tum(path, trajectory)
    again = read_tum(path)
    np.testing.assert_array_equal(again.stamps, trajectory.stamps)
    np.testing.assert_array_equal(again.T_world_sensor.translation, trajectory.T_world_sensor.translation)
    np.testing.assert_allclose(again.T_world_sensor.as_matrix(), trajectory.T_world_sensor.as_matrix(), atol=1e-15)


POSE, UNIT = "0 1 2 3 0 0 0 1\n", "1 0 0 5 0 1 0 6 0 0 1 7\n"
MATRIX = "0 -1 0 4\n1 0 0 5\n0 0 1 6\n0 0 0 1\n"
TWO = f"3 7\n{MATRIX}\n7\t 12  60 \n{MATRIX}"


V0 = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1"
V1 = "VERTEX_SE3:QUAT 1 1 2 3 0.1 0.2 0.3 0.9"
INFORMATION = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
E01 = f"EDGE_SE3:QUAT 0 1 1 2 3 0 0 0 1 {INFORMATION}"


GRAPH_FAULTS = (
    ([V0, V1.replace("0.2", "nan")], "line 2 .*NaN"),
    ([V0, V1, E01.replace(" 3 ", " NaN ")], "line 3 .*NaN"),
    ([V0, V1, "", "# a comment", E01.rsplit(" ", 1)[0]], "line 5 has 29 columns; wanted 30"),
    (
        [V0, "VERTEX_SE2 1 2 3 4"],
        "line 2 .*'VERTEX_SE2'.*VERTEX_SE3:QUAT, EDGE_SE3:QUAT, EDGE_SE3_PRIOR, EDGE_SE3_PRIOR:QUAT, FIX",
    ),
    ([V1, V0, V1], "line 3 gives vertex 1 again, after 1"),
    ([V0, V1, E01.replace("0 1", "0 7", 1)], "line 3 names vertex 7"),
    ([V0, V1, E01.replace("0 1", "1 1", 1)], "line 3.*two different poses"),
    ([V0, V1.replace(" 1 1 ", " 1.5 1 ")], "line 2.*whole numbers"),
    ([V0, V1, "FIX"], "line 3"),
    ([V0, V1, E01.replace("1 0 0 0 0 0 1", "1 2 0 0 0 0 1")], "line 3.*not positive definite"),
    ([E01.replace("0 1", "0 2", 1)], "no VERTEX_SE3:QUAT"),
)


@pytest.mark.parametrize(
    ("read", "text", "words"),
    [
        (read_tum, f"# comment\n{POSE}1 1 2 3 0 0 0\n", "line 3 has 7 columns.*stamp tx"),
        (read_tum, f"{POSE}\nnan 1 2 3 0 0 0 1\n", "line 3 .*NaN"),
        (read_tum, "0 1 two 3 0 0 0 1\n", "line 1.*'two'"),
        (read_tum, "0 1 2 3 0 0 0 0\n", "line 1 .*zero quaternion"),
        (read_kitti, f"{UNIT}1 0 0 5 0 1 0 6 0 0 -1 7\n", "line 2 is not a rigid transform"),
        (read_gt_log, "", "holds no line"),
        (read_gt_log, f"0\n{MATRIX}", r"line 1 is '0'; wanted two scans"),
        (read_gt_log, f"0 1\n{MATRIX}{MATRIX}", "line 6 is '0 -1 0 4'"),
        (read_gt_log, f"4 4\n{MATRIX}", "line 1 pairs the scan 4 with itself"),
        (read_gt_log, f"{TWO}0 1\n1 0 0 0\n", "the pair in line 12 has 1 rows; wanted four"),
        (read_gt_log, "0 1\n" + MATRIX.replace("6", "nan"), "line 4 holds NaN or infinity"),
        (
            read_gt_log,
            "0 1\n" + MATRIX.replace("-1", "-1.01"),
            "pair in line 1 is not a rigid transform: .*off by 0.02",
        ),
        (read_gt_log, f"{TWO}3 7\n{MATRIX}", "lines 1 and 12 are both for the scans 3 and 7; delete one"),
        *((read_g2o, "\n".join([*lines, ""]), words) for lines, words in GRAPH_FAULTS),
    ],
)
def test_invalid_lines_are_refused_with_their_number(tmp_path, read, text, words):
    (tmp_path / "bad.txt").write_text(text)
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path / "bad.txt")
    assert str(tmp_path / "bad.txt") in str(error.value)


@pytest.mark.parametrize("read", [read_tum, read_kitti, read_g2o])
def test_empty_cut_missing_and_binary_files_are_refused(read, tmp_path):
    (tmp_path / "empty").write_text("")
    (tmp_path / "cut").write_text("0 1 2 3 0 0 0 1")
    (tmp_path / "binary").write_bytes(bytes(range(256)) + b"\n")
    for name in ("empty", "cut", "missing", "binary"):
        refuses(name, read, tmp_path / name)


def test_to_json_replaces_nan_and_types_of_numpy():
    @dataclass
    class Point:
        x: float
        name: str

    for value, wanted in (
        ({1: np.float32(0.5)}, {"1": 0.5}),
        ([float("nan"), np.inf, np.array([1.0, np.nan])], [None, None, [1.0, None]]),
        ((np.int64(3), True, np.bool_(False)), [3, True, False]),
        (Path("a") / "b", str(Path("a") / "b")),
        (Point(float("-inf"), "p"), {"x": None, "name": "p"}),
        ({3, 1}, [1, 3]),
    ):
        assert to_json(value) == wanted
    with pytest.raises(TypeError, match="object"):
        to_json(object())


def test_pairs_of_a_gt_log_are_read_in_order_with_or_without_a_third_number(tmp_path: Path) -> None:
    (tmp_path / "gt.log").write_text(TWO)
    pairs = read_gt_log(tmp_path / "gt.log")
    assert [(pair.i, pair.j, pair.line) for pair in pairs] == [(3, 7, 1), (7, 12, 7)]
    np.testing.assert_allclose(pairs[0].T_i_j.apply([1, 0, 0]), [4, 6, 6], atol=1e-12)
    # digits that were cut off do no harm
    (tmp_path / "gt.log").write_text("0 1\n0.6 -0.8 0 0\n0.80004 0.6 0 0\n0 0 1 0\n0 0 0 1\n")
    R = read_gt_log(tmp_path / "gt.log")[0].T_i_j.rotation.as_matrix()
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


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


def test_a_g2o_graph_is_read_back(tmp_path):
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


def test_gtsam_reads_the_same_poses_and_noise(tmp_path):
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


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(KNOWN))
@pytest.mark.skipif(not GRAPHS.is_dir(), reason=f"the benchmark graphs are not at {GRAPHS}")
def test_public_graphs_reach_the_costs_of_gtsam(name, tmp_path):
    poses, edges, before, after = KNOWN[name]
    graph = read_g2o(GRAPHS / f"{name}.g2o")
    assert (len(graph.trajectory), len(graph.edges)) == (poses, edges)
    assert len(graph.components) == 1
    write_g2o(tmp_path / "a.g2o", graph)
    solution = read_g2o(tmp_path / "a.g2o").optimize()
    assert solution.chi_squared_before == pytest.approx(before, rel=1e-8)
    assert solution.chi_squared_after == pytest.approx(after, rel=1e-8)


def test_quaternions_are_normalized_and_vertices_sorted(tmp_path):
    path = tmp_path / "a.g2o"
    edge, first = E01.replace("0 1", "10 30", 1), V0.replace(" 0", " 10", 1)
    path.write_text(f"{edge}\nVERTEX_SE3:QUAT 30 1 2 3 0 0 2 2\n{first}\n")
    graph = read_g2o(path)
    np.testing.assert_array_equal(graph.trajectory.stamps, [10, 30])
    R = graph.trajectory.T_world_sensor.rotation.as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(R, [[0, 0, 0], [90, 0, 0]], atol=1e-12)
    assert (graph.edges[0].i, graph.edges[0].j, graph.edges[0].kind) == (0, 1, "sequential")


def test_a_graph_with_priors_is_not_written(tmp_path):
    T = RigidTransform.identity(1)
    graph = PoseGraph(Trajectory(np.zeros(1), T), (edge(0, 0, T[0], np.eye(6), "prior"),))
    refuses("prior", write_g2o, tmp_path / "a.g2o", graph)
    assert list(tmp_path.iterdir()) == []


def test_kitti_takes_rotations_of_six_digits(tmp_path):
    T = random_transforms(np.random.default_rng(1), 20)
    rows = T.as_matrix()[:, :3].reshape(-1, 12)
    np.savetxt(tmp_path / "a.txt", rows, fmt="%.6e")
    again = read_kitti(tmp_path / "a.txt").T_world_sensor
    np.testing.assert_allclose(again.as_matrix(), T.as_matrix(), atol=1e-5)
    R = again.rotation.as_matrix()
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (20, 1, 1)), atol=1e-14)
