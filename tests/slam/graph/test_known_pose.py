"""What is known of single poses: how it counts, what it leaves open, and that a file of it gives the same poses."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.gauge import undetermined
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.known_pose import KnownPose, blocks
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.optimize.solve import optimize
from sonarmap.tools.files.readers.poses.g2o import read_g2o
from sonarmap.tools.files.writers.g2o import write_g2o
from tests.slam.graph.test_pose_priors import graph, ring, told

T = RigidTransform.from_components([40.0, -3.0, 7.0], Rotation.from_euler("ZYX", [1.1, -0.3, 0.2]))
OFF = np.array([0.01, -0.02, 0.005, 0.3, -0.1, 0.2])


def semidefinite(size: int, rank: int, seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(size, rank))
    return 100 * root @ root.T


def moved(off: np.ndarray) -> RigidTransform:
    """T turned and shifted in its own axes."""
    R = T.rotation
    return RigidTransform.from_components(T.translation + R.apply(off[3:]), R * Rotation.from_rotvec(off[:3]))


def squared(known: KnownPose, at: RigidTransform) -> float:
    values = to_values(RigidTransform.concatenate([at]))
    return 2 * sum(factor.error(values) for factor in known.factors())


@pytest.mark.parametrize(("turns", "shifts"), [(3, 3), (2, 1), (0, 2), (1, 0)])
def test_it_counts_as_its_information_says(turns: int, shifts: int) -> None:
    information = blocks(semidefinite(3, turns, 1), semidefinite(3, shifts, 2))
    known = KnownPose(0, T, information)
    assert known.rank == turns + shifts
    assert squared(known, moved(OFF)) == pytest.approx(OFF @ information @ OFF, rel=1e-9)


def test_coupled_turns_and_shifts_count_too() -> None:
    information = semidefinite(6, 4, 3)
    small = 1e-3 * OFF
    assert squared(KnownPose(0, T, information), moved(small)) == pytest.approx(small @ information @ small, rel=1e-3)


@pytest.mark.parametrize(
    ("information", "words"),
    [
        (np.diag([1.0, 1, 1, 1, 1, -0.1]), "indefinite"),
        (np.eye(5), "shape"),
        (np.full((6, 6), np.nan), "not finite"),
        (np.eye(6) + np.eye(6, k=1), "not symmetric"),
    ],
)
def test_what_is_no_information_is_refused(information: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        KnownPose(0, T, information)


@pytest.mark.parametrize(
    ("diagonal", "free"), [([1, 1, 1, 1, 1, 1], 0), ([1, 1, 0, 0, 0, 1], 3), ([0, 0, 0, 1, 1, 1], 3)]
)
def test_what_one_pose_leaves_open_is_held(diagonal: list[float], free: int) -> None:
    truth, _ = ring(6)
    known = KnownPose(2, truth[2], 1e4 * np.diag(diagonal))
    held = undetermined(range(6), [known], truth)
    assert (held.rank if held else 0) == free


def test_shifts_of_three_poses_leave_nothing_open() -> None:
    truth, _ = ring(6)
    known = [KnownPose(k, truth[k], np.diag([0.0, 0, 0, 1, 1, 1])) for k in (0, 2, 4)]
    assert undetermined(range(6), known, truth) is None


@pytest.mark.parametrize(
    "measured", [("attitude", "heading", "position", "depth"), ("attitude", "depth"), ("position", "heading")]
)
def test_the_file_of_a_graph_gives_its_poses(measured: tuple[str, ...], tmp_path: Path) -> None:
    truth, edges = ring(12, seed=4)
    rng = np.random.default_rng(5)
    shifted = [RigidTransform.from_translation(rng.normal(0, 0.3, 3)) * truth[k] for k in range(12)]
    solved = graph(edges, {k: told(shifted[k], *measured) for k in range(0, 12, 2)}, 12).optimize()
    for _ in range(3):
        solved = solved.graph.optimize()
    write_g2o(tmp_path / "graph.g2o", solved.graph)
    read = read_g2o(tmp_path / "graph.g2o")
    assert "EDGE_SE3_PRIOR" in (tmp_path / "graph.g2o").read_text()
    again = optimize(read, "full")
    off = (solved.trajectory.T_world_sensor.inv() * again.graph.trajectory.T_world_sensor).as_exp_coords()
    np.testing.assert_allclose(off, 0, atol=1e-6)
    assert again.chi_squared[1] == pytest.approx(solved.chi_squared_after, rel=1e-6)
    assert again.degrees_of_freedom == solved.degrees_of_freedom


def test_poses_that_nothing_places_are_no_vertices(tmp_path: Path) -> None:
    _, edges = ring(5)
    whole = graph(edges[:3], {}, 5)
    write_g2o(tmp_path / "graph.g2o", whole, left_out={4})
    read = read_g2o(tmp_path / "graph.g2o")
    assert read.trajectory.stamps.tolist() == [0, 1, 2, 3]
    assert len(read.components) == 1


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["EDGE_SE3_PRIOR 7 0 0 0 0 0 0 0 1 " + " ".join(["1"] + ["0"] * 20)], "vertex 7, which the file does not"),
        (["EDGE_SE3_PRIOR 0 0 0 0 0 0 0 0 1 " + " ".join(["-1"] + ["0"] * 20)], "line 2: .*indefinite"),
        (["EDGE_SE3_PRIOR 0 0 0 0 0 0 0 0 1 1 2 3"], "line 2"),
        (
            ["PARAMS_SE3OFFSET 0 0 0 1 0 0 0 1", "EDGE_SE3_PRIOR 0 0 0 0 0 0 0 0 1 " + " ".join(["0"] * 21)],
            "line 2: priors of a sensor that is not where the vertex is",
        ),
    ],
)
def test_faulty_lines_are_named(lines: list[str], words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text("\n".join(["VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1", *lines]) + "\n")
    with pytest.raises(InputError, match=words):
        read_g2o(path)


def test_a_graph_without_them_has_no_such_lines(tmp_path: Path) -> None:
    _, edges = ring(4)
    write_g2o(tmp_path / "graph.g2o", PoseGraph(graph(edges, {}, 4).trajectory, tuple(edges)))
    assert "PRIOR" not in (tmp_path / "graph.g2o").read_text()
