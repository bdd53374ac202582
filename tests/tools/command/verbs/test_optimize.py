"""`sonarmap optimize` end to end: its summary, its files, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import chain
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.writers.poses import write_g2o
from tests.samples.clutter_scans import printed, refused, said, sonarmap
from tests.samples.places import DATA
from tests.samples.surveys import edge, random_covariance, ring_poses

GRAPHS = DATA / "graphs"
# The best known values of F: those of the benchmark's FSTAR.txt
BEST = {"tinyGrid3D": 18.5193664, "smallGrid3D": 1025.39806, "parking-garage": 1.26252443, "sphere2500": 1687.00581}
needs_graphs = pytest.mark.skipif(not GRAPHS.is_dir(), reason=f"the benchmark graphs are not at {GRAPHS}")

KEYS = {"start", "poses", "edges", "components", "chi_squared_before", "chi_squared_after", "degrees_of_freedom"}
KEYS |= {"iterations", "converged", "loops", "seconds"}


def ring(seed: int = 0, loops: bool = True) -> PoseGraph:
    """A graph of twelve poses in a ring with noisy edges, started from the chain."""
    rng = np.random.default_rng(seed)
    T = ring_poses(12)
    pairs = [(k, k + 1) for k in range(11)] + ([(11, 0), (2, 8), (3, 9), (9, 4)] if loops else [])
    edges = []
    for i, j in pairs:
        covariance = random_covariance(rng)
        noise = RigidTransform.from_exp_coords(rng.multivariate_normal(np.zeros(6), covariance))
        edges.append(edge(i, j, T[i].inv() * T[j] * noise, covariance, "sequential" if j == i + 1 else "loop"))
    return PoseGraph(chain(edges, np.arange(12.0)), tuple(edges))


@pytest.fixture
def source(tmp_path: Path) -> Path:
    write_g2o(tmp_path / "in.g2o", ring())
    return tmp_path / "in.g2o"


def summary_of(source: Path, *options: str) -> dict:
    return printed(sonarmap("optimize", source, "-o", source.parent / "out.g2o", "--json", *options))


@pytest.fixture
def wrong_loop(source: Path) -> Path:
    """The ring with a loop that is 40 m off, before its other edges."""
    graph = read_g2o(source)
    wrong = edge(1, 6, RigidTransform.from_translation([40.0, -3, 2]), np.eye(6) * 1e-3, "loop")
    write_g2o(source, PoseGraph(graph.trajectory, (wrong, *graph.edges)))
    return source


def test_every_field_is_reported(source: Path) -> None:
    summary = summary_of(source)
    assert set(summary) == KEYS
    assert (summary["poses"], summary["edges"], summary["components"]) == (12, 15, 1)
    assert summary["degrees_of_freedom"] == 6 * (15 - 11)
    assert summary["chi_squared_after"] < summary["chi_squared_before"]
    assert {"read", "optimize", "total"} <= set(summary["seconds"])
    assert [(loop["i"], loop["j"]) for loop in summary["loops"]] == [(11, 0), (2, 8), (3, 9), (9, 4)]
    assert {loop["verdict"] for loop in summary["loops"]} == {"accepted"}
    written = read_g2o(source.parent / "out.g2o")
    assert written.chi_squared == pytest.approx(summary["chi_squared_after"], rel=1e-6)
    assert written.chi_squared == pytest.approx(read_g2o(source).optimize().chi_squared_after, rel=1e-6)


def test_an_indefinite_information_is_refused(source: Path) -> None:
    lines = source.read_text().splitlines()
    number = next(n for n, line in enumerate(lines) if line.startswith("EDGE_SE3:QUAT 2 8"))
    fields = lines[number].split()
    fields[10] = "-5"  # of the x direction
    lines[number] = " ".join(fields)
    source.write_text("\n".join(lines) + "\n")
    out = source.parent / "out.g2o"
    refused(sonarmap("optimize", source, "-o", out), f"line {number + 1}", "not positive definite")
    assert not out.exists()


def test_lines_other_than_poses_are_unchanged(tmp_path: Path) -> None:
    write_g2o(tmp_path / "a.g2o", ring())
    lines = (tmp_path / "a.g2o").read_text().splitlines()
    ids = [line.replace("SE3:QUAT 1 ", "SE3:QUAT 700 ").replace(" 1 2 ", " 700 2 ", 1) for line in lines]
    given = ["# a survey", *[line if line.startswith("V") else "  " + line.replace(" 0 1 ", " 0 700 ") for line in ids]]
    given.insert(3, "FIX 700")
    (tmp_path / "in.g2o").write_text("\n".join(given) + "\n")
    assert sonarmap("optimize", tmp_path / "in.g2o", "-o", tmp_path / "out.g2o").exit_code == 0
    out = (tmp_path / "out.g2o").read_text().splitlines()
    assert len(out) == len(given)
    for before, after in zip(given, out, strict=True):
        if before.startswith("VERTEX"):
            assert after.split()[:2] == before.split()[:2]
        else:
            assert after == before
    fixed = [read_g2o(tmp_path / name).trajectory.T_world_sensor[11].as_matrix() for name in ("in.g2o", "out.g2o")]
    np.testing.assert_allclose(*fixed, atol=1e-5)


def test_a_wrong_loop_is_rejected_and_listed(wrong_loop: Path) -> None:
    graph, source = read_g2o(wrong_loop), wrong_loop
    (out,) = [loop for loop in summary_of(source, "--robust")["loops"] if loop["verdict"] == "rejected"]
    assert (out["i"], out["j"], out["kind"]) == (1, 6, "loop")
    assert out["sigmas"] > 100
    assert "rejected" in out["reason"]
    assert len(read_g2o(source.parent / "out.g2o").edges) == len(graph.edges) - 1
    result = sonarmap("optimize", source, "-o", source.parent / "out.g2o", "--robust")
    assert "1 edge, left out; --json lists them" in result.stdout
    assert len([loop for loop in summary_of(source)["loops"] if loop["verdict"] == "accepted"]) == 5
    assert result.stdout.startswith(("The poses fit", "The edges contradict"))


def test_a_graph_without_loops_is_reported(tmp_path: Path) -> None:
    write_g2o(tmp_path / "in.g2o", ring(loops=False))
    result = sonarmap("optimize", tmp_path / "in.g2o", "-o", tmp_path / "out.g2o")
    assert "every pose follows from one edge" in result.stdout


def test_unconnected_parts_are_refused_with_line_and_vertices(tmp_path: Path) -> None:
    graph = ring()
    write_g2o(tmp_path / "in.g2o", PoseGraph(graph.trajectory, graph.edges[:4] + graph.edges[5:10]))
    result = sonarmap("optimize", tmp_path / "in.g2o", "-o", tmp_path / "out.g2o")
    refused(result, "line 6: no edges join vertex 5 to vertex 0", "join 3 parts")
    assert not (tmp_path / "out.g2o").exists()


def test_bad_options(source: Path) -> None:
    refused(sonarmap("optimize", source, "-o", source), "is also the input")
    refused(sonarmap("optimize", source, "-o", "out.g2o", "--start", "random"), "choose one of chordal, given")


def test_a_single_pose_is_refused(tmp_path: Path) -> None:
    (tmp_path / "one.g2o").write_text("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n")
    said(sonarmap("optimize", tmp_path / "one.g2o", "-o", tmp_path / "out.g2o"), "nothing to optimize")


def test_an_optimizer_that_does_not_converge_is_reported(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    optimize = PoseGraph.optimize
    monkeypatch.setattr(PoseGraph, "optimize", lambda self: optimize(self, max_iterations=1))
    out = source.parent / "out.g2o"
    result = sonarmap("optimize", source, "-o", out, "--start", "given")
    assert result.exit_code == 3
    said(result, "did not converge in 1 iterations")
    assert len(read_g2o(out).trajectory) == 12


def isotropic_cost(graph: PoseGraph) -> float:
    """F of SE-Sync (IJRR 2019, DOI 10.1177/0278364918784361): one weight for each edge's rotation and translation."""
    T, cost = graph.trajectory.T_world_sensor, 0.0
    for each in graph.edges:
        R, t, covariance = T[each.i].rotation, each.registration.T_target_source, each.registration.covariance
        kappa, tau = 1.5 / np.trace(covariance[:3, :3]), 3 / np.trace(covariance[3:, 3:])
        turned = T[each.j].rotation.as_matrix() - (R * t.rotation).as_matrix()
        moved = T[each.j].translation - T[each.i].translation - R.apply(t.translation)
        cost += kappa * (turned**2).sum() + tau * (moved**2).sum()
    return cost


@pytest.mark.quick_cases(1)
@needs_graphs
@pytest.mark.parametrize("name", sorted(BEST, reverse=True))
def test_benchmarks_come_close_to_the_best_known_cost(name: str, tmp_path: Path) -> None:
    """Their optimum is of another cost, which is the same to first order where the edges' errors are isotropic."""
    (tmp_path / "in.g2o").symlink_to(GRAPHS / f"{name}.g2o")
    summary_of(tmp_path / "in.g2o")
    cost = isotropic_cost(read_g2o(tmp_path / "out.g2o"))
    assert BEST[name] * (1 - 1e-6) <= cost <= 1.03 * BEST[name]
