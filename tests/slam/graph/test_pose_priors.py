"""Priors of instruments and files in the graph: their weights, and the unmeasured motions, which are held."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gauge import MotionInformation
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.place import place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.slam.optimize.solve import optimize
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.writers.poses import write_g2o
from tests.samples.surveys import chain_edges, chained_graph, drawn, random_covariance, ring_poses

SIGMAS = np.array([0.004, 0.007, 0.02, 0.5, 0.8, 0.05])
T_WORLD = RigidTransform.from_components([310.0, -45.0, -12.0], Rotation.from_euler("ZYX", [2.1, 0.2, -0.1]))


def ring(count: int, seed: int = 0) -> tuple[RigidTransform, list[Edge]]:
    """True poses in the world, and a chain of noisy edges between them."""
    truth = T_WORLD * ring_poses(count)
    rng = np.random.default_rng(seed)
    covariance = random_covariance(rng, 0.004, 0.03)
    return truth, chain_edges(truth, covariance, drawn(rng, covariance, count - 1))


def prior_of(T: RigidTransform, *known: str) -> PosePrior:
    """A prior without an error, of attitude, heading, position or depth."""
    names = ("attitude", "attitude", "heading", "position", "position", "depth")
    return PosePrior(T, np.where([name in known for name in names], SIGMAS, np.inf))


def graph(edges: list[Edge], priors: dict[int, PosePrior], count: int) -> PoseGraph:
    start = place_in_world(chain(edges, np.zeros(count)), [range(count)], priors)
    return PoseGraph(start, tuple(edges), priors=tuple(priors.items()))


def test_an_unmeasured_heading_does_not_count():
    """The measured tilt counts the same, whatever heading the prior's pose has."""
    truth, edges = ring(5)
    results = []
    for turn in (0.0, 1.7):
        turned = RigidTransform.from_rotation(Rotation.from_euler("Z", turn)) * truth
        priors = {k: prior_of(turned[k], "attitude", "position", "depth") for k in range(5)}
        priors = {
            k: PosePrior(RigidTransform.from_components(truth[k].translation, p.T_world_sensor.rotation), p.sigmas)
            for k, p in priors.items()
        }
        results.append(graph(edges, priors, 5).optimize())
    first, second = (solution.trajectory.T_world_sensor for solution in results)
    np.testing.assert_allclose((first.inv() * second).as_exp_coords(), 0, atol=2e-5)
    assert results[0].chi_squared_after == pytest.approx(results[1].chi_squared_after, rel=1e-3)


def test_a_chain_is_placed_by_headings_or_by_positions():
    truth, _ = ring(8)
    part = Trajectory(np.zeros(8), truth[0].inv() * truth)
    for known in (("attitude", "heading", "position", "depth"), ("attitude", "position", "depth")):
        priors = {k: prior_of(truth[k], *known) for k in (1, 4, 6)}
        placed = place_in_world(part, [range(8)], priors)
        np.testing.assert_allclose((truth.inv() * placed.T_world_sensor).as_exp_coords(), 0, atol=1e-9)
    untouched = place_in_world(part, [range(8)], {})
    np.testing.assert_array_equal(untouched.T_world_sensor.as_matrix(), part.T_world_sensor.as_matrix())


T_KNOWN = RigidTransform.from_components([40.0, -3.0, 7.0], Rotation.from_euler("ZYX", [1.1, -0.3, 0.2]))
OFF = np.array([0.01, -0.02, 0.005, 0.3, -0.1, 0.2])


def semidefinite(size: int, rank: int, seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(size, rank))
    return 100 * root @ root.T


def moved(off: np.ndarray) -> RigidTransform:
    """T_KNOWN turned and shifted in its own axes."""
    R = T_KNOWN.rotation
    return RigidTransform.from_components(T_KNOWN.translation + R.apply(off[3:]), R * Rotation.from_rotvec(off[:3]))


def squared(known: KnownPose, at: RigidTransform) -> float:
    values = to_values(RigidTransform.concatenate([at]))
    return 2 * sum(factor.error(values) for factor in known.factors())


@pytest.mark.parametrize(("turns", "shifts"), [(3, 3), (2, 1), (0, 2)])
def test_a_known_pose_counts_by_its_information(turns: int, shifts: int) -> None:
    information = block_diag(semidefinite(3, turns, 1), semidefinite(3, shifts, 2))
    known = KnownPose(0, T_KNOWN, information)
    assert known.rank == turns + shifts
    assert squared(known, moved(OFF)) == pytest.approx(OFF @ information @ OFF, rel=1e-9)


@pytest.mark.parametrize(
    ("information", "words"),
    [
        (np.diag([1.0, 1, 1, 1, 1, -0.1]), "indefinite"),
        (np.full((6, 6), np.nan), "not finite"),
    ],
)
def test_invalid_information_is_refused(information: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        KnownPose(0, T_KNOWN, information)


@pytest.mark.parametrize(
    ("diagonal", "free"), [([1, 1, 1, 1, 1, 1], 0), ([1, 1, 0, 0, 0, 1], 3), ([0, 0, 0, 1, 1, 1], 3)]
)
def test_motions_that_one_pose_leaves_unconstrained_are_held(diagonal: list[float], free: int) -> None:
    truth, _ = ring(6)
    known = KnownPose(2, truth[2], 1e4 * np.diag(diagonal))
    assert open_axes([known], truth) == free
    # positions of three poses constrain all motions
    known = [KnownPose(k, truth[k], np.diag([0.0, 0, 0, 1, 1, 1])) for k in (0, 2, 4)]
    assert open_axes(known, truth) == 0


def open_axes(known: list[KnownPose], T: RigidTransform) -> int:
    """Number of unconstrained motions of all poses."""
    motion = MotionInformation.of(T, known).open_motion(range(len(T)))
    assert motion is not None
    return motion.axes.shape[1]


@pytest.mark.parametrize("measured", [("attitude", "depth"), ("position", "heading")])
def test_the_file_of_a_graph_reproduces_its_poses(measured: tuple[str, ...], tmp_path: Path) -> None:
    truth, edges = ring(12, seed=4)
    rng = np.random.default_rng(5)
    shifted = [RigidTransform.from_translation(rng.normal(0, 0.3, 3)) * truth[k] for k in range(12)]
    solved = graph(edges, {k: prior_of(shifted[k], *measured) for k in range(0, 12, 2)}, 12).optimize()
    for _ in range(3):
        solved = solved.graph.optimize()
    write_g2o(tmp_path / "graph.g2o", solved.graph)
    read = read_g2o(tmp_path / "graph.g2o")
    assert "EDGE_SE3_PRIOR" in (tmp_path / "graph.g2o").read_text()
    again = optimize(read)
    off = (solved.trajectory.T_world_sensor.inv() * again.graph.trajectory.T_world_sensor).as_exp_coords()
    np.testing.assert_allclose(off, 0, atol=1e-4)
    assert again.chi_squared_after == pytest.approx(solved.chi_squared_after, rel=1e-4)
    assert again.degrees_of_freedom == solved.degrees_of_freedom


def test_left_out_poses_are_no_vertices(tmp_path: Path) -> None:
    _, edges = ring(5)
    whole = graph(edges[:3], {}, 5)
    write_g2o(tmp_path / "graph.g2o", whole, left_out={4})
    read = read_g2o(tmp_path / "graph.g2o")
    assert read.trajectory.stamps.tolist() == [0, 1, 2, 3]
    assert len(read.components) == 1
    # a graph without priors has no such lines
    write_g2o(tmp_path / "graph.g2o", chained_graph(edges, 5))
    assert "PRIOR" not in (tmp_path / "graph.g2o").read_text()


@pytest.mark.parametrize("head", ["EDGE_SE3_PRIOR 3 9", "EDGE_SE3_PRIOR:QUAT 3 3", "EDGE_SE3_PRIOR:QUAT 3"])
def test_priors_of_other_programs_count_the_same(head: str, tmp_path: Path) -> None:
    """With or without the number of an offset: pose, then information, translation first, about the pose's own axes."""
    information, order = semidefinite(6, 4, 3), [3, 4, 5, 0, 1, 2]
    upper = information[np.ix_(order, order)][np.triu_indices(6)]
    pose = [*T_KNOWN.translation, *T_KNOWN.rotation.as_quat()]
    path = tmp_path / "prior.g2o"
    vertex = f"VERTEX_SE3:QUAT 3 {' '.join(map(repr, map(float, pose)))}"
    path.write_text(f"{vertex}\n{head} {' '.join(map(repr, map(float, [*pose, *upper])))}\n")
    (known,) = read_g2o(path).known
    np.testing.assert_allclose(known.information, information, rtol=1e-12)
    small = 1e-3 * OFF
    assert squared(known, moved(small)) == pytest.approx(small @ information @ small, rel=1e-3)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["EDGE_SE3_PRIOR 7 0 0 0 0 0 0 0 1 " + " ".join(["1"] + ["0"] * 20)], "vertex 7, which the file does not"),
        (["EDGE_SE3_PRIOR 0 0 0 0 0 0 0 0 1 " + " ".join(["-1"] + ["0"] * 20)], "line 2: .*indefinite"),
        (["EDGE_SE3_PRIOR:QUAT 0 0 0 0"], "line 2 has 4 columns; wanted 30"),
        (
            ["PARAMS_SE3OFFSET 0 0 0 1 0 0 0 1", "EDGE_SE3_PRIOR 0 0 0 0 0 0 0 0 1 " + " ".join(["0"] * 21)],
            "line 2: priors with a sensor offset are not supported",
        ),
    ],
)
def test_faulty_lines_are_named(lines: list[str], words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text("\n".join(["VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1", *lines]) + "\n")
    with pytest.raises(InputError, match=words):
        read_g2o(path)


@pytest.mark.parametrize("row", range(6))
def test_each_error_counts_with_its_own_sigma(row):
    """A fixed pose with a prior: chi-squared is the error over its sigma, squared."""
    measured = T_WORLD
    off = np.zeros(6)
    off[row] = 0.3 * SIGMAS[row]
    w = Rotation.from_euler("Z", twist(measured.rotation)).apply(off[:3])
    true = RigidTransform.from_components(measured.translation + off[3:], Rotation.from_rotvec(w) * measured.rotation)
    held = PoseGraph(
        Trajectory(np.zeros(1), RigidTransform.concatenate([true])), (), (0,), ((0, PosePrior(measured, SIGMAS)),)
    )
    assert held.optimize().chi_squared_after == pytest.approx(0.09, rel=1e-3)
