"""Fixes that everything else contradicts are found, and no others; and what an edge costs an optimum."""

from dataclasses import replace
from itertools import accumulate
from operator import mul

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.robust import contradicted_edges
from sonarmap.slam.decide.wrong_measurements import NOTHING, agreement, judge_fixes
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import unexact
from tests.samples.surveys import chain_edges, chained_graph, drawn, edge, measured_edge, random_covariance, ring_poses

COUNT = 60
TRUTH = RigidTransform.from_components([300.0, -80.0, -20.0], Rotation.from_euler("Z", 0.7)) * ring_poses(COUNT, 30.0)
COVARIANCE = random_covariance(np.random.default_rng(4), 0.002, 0.03)
SIGMAS = np.array([0.01, 0.01, 0.05, 1.0, 1.0, 0.2])


def edges(seed: int) -> tuple[Edge, ...]:
    return tuple(chain_edges(TRUTH, COVARIANCE, drawn(np.random.default_rng(seed), COVARIANCE, COUNT)[:-1]))


def fixes(seed: int, every: int = 1, known: slice = slice(0, 6)) -> dict[int, PosePrior]:
    rng = np.random.default_rng([seed, 1])
    sigmas = np.full(6, np.inf)
    sigmas[known] = SIGMAS[known]
    return {k: replace(unexact(TRUTH[k], rng, SIGMAS), sigmas=sigmas.copy()) for k in range(0, COUNT, every)}


def moved(prior: PosePrior, way: tuple[float, float, float] = (0, 0, 0), heading: float = 0.0) -> PosePrior:
    T = prior.T_world_sensor
    R = Rotation.from_euler("Z", heading, degrees=True) * T.rotation
    return replace(prior, T_world_sensor=RigidTransform.from_components(T.translation + np.array(way), R))


def found(seed: int, priors: dict[int, PosePrior]) -> tuple[dict[int, PosePrior], list[tuple[int, str]]]:
    start = Trajectory(np.arange(float(COUNT)), TRUTH * RigidTransform.from_exp_coords([0.01, 0, 0.02, 0.3, 0.2, 0]))
    judged = judge_fixes(PoseGraph(start, edges(seed)), priors)
    return judged.priors, [(fix.scan, fix.kind) for fix in judged.wrong]


@pytest.mark.parametrize("seed", range(2))
def test_right_fixes_are_unchanged(seed: int) -> None:
    priors = fixes(seed)
    left, wrong = found(seed, priors)
    assert not wrong
    assert left == priors


def test_acoustic_outliers_and_compass_jumps_are_named() -> None:
    seed = 0
    priors = fixes(seed)
    priors[7] = moved(priors[7], (20.0, 0.0, 0.0))
    priors[31] = moved(priors[31], (-12.0, 16.0, 0.0))
    priors[32] = moved(priors[32], heading=40.0)
    priors[50] = moved(priors[50], (0.0, 0.0, 4.0))
    left, wrong = found(seed, priors)
    assert wrong == [(7, "position"), (31, "position"), (32, "heading"), (50, "depth")]
    assert not left[7].knows_position
    assert left[7].knows_depth
    assert not left[32].knows_heading
    assert left[32].knows_position


def test_sparse_wrong_fix_is_named_but_not_a_single_fix_or_half_of_them() -> None:
    priors = fixes(1, every=6, known=slice(3, 5))
    priors[24] = moved(priors[24], (0.0, -20.0, 0.0))
    left, wrong = found(1, priors)
    assert wrong == [(24, "position")]
    assert 24 not in left
    assert found(2, {0: moved(fixes(2)[0], (500.0, 0.0, 0.0))})[1] == []
    # a step of the chain to a twin moves half of the survey: that is told by the graph, not here
    priors = {k: moved(prior, (40.0, 0, 0)) if k % 2 else prior for k, prior in fixes(3).items()}
    assert found(3, priors)[1] == []


def test_run_of_wrong_fixes_is_named_even_if_a_third_of_all() -> None:
    seed = 1
    priors = fixes(seed, known=slice(2, 5))
    for k in range(25, 45):
        priors[k] = moved(priors[k], (18.0, -16.0, 0.0))
    left, wrong = found(seed, priors)
    assert wrong == [(k, "position") for k in range(25, 45)]
    assert left[30].knows_heading


@pytest.mark.parametrize("heading", [0.0, 200.0])
def test_attitude_errors_count_the_same_at_every_heading(heading: float) -> None:
    """Errors of roll and pitch are about the sensor's own level axes, wherever it points: one sigma of pitch is one."""
    sigmas = np.array([np.deg2rad(0.1), np.deg2rad(5.0), np.inf, np.inf, np.inf, np.inf])
    R = Rotation.from_euler("ZYX", [heading, 20.0, 0.0], degrees=True)
    priors = {k: PosePrior(RigidTransform.from_rotation(R), sigmas) for k in range(3)}
    off = Rotation.from_rotvec(Rotation.from_euler("Z", twist(R)).apply([0.0, sigmas[1], 0.0]))
    T = RigidTransform.from_rotation(Rotation.concatenate([off * R] * 3))
    assert agreement(priors, (), T)["attitude"][2] == pytest.approx(np.sqrt(1 / 2), rel=1e-6)
    graph = PoseGraph(Trajectory(np.arange(3.0), T), (), priors=tuple(priors.items()))
    assert graph.chi_squared == pytest.approx(3.0, rel=1e-3)


def test_underestimated_sigmas_are_scaled_to_the_actual_errors() -> None:
    seed = 2
    priors = {k: replace(prior, sigmas=prior.sigmas / [1, 1, 1, 5, 5, 1]) for k, prior in fixes(seed).items()}
    priors[9] = moved(priors[9], (30.0, 0.0, 0.0))
    judged = judge_fixes(PoseGraph(Trajectory(np.arange(float(COUNT)), TRUTH), edges(seed)), priors)
    assert list(judged.understated) == ["position"]
    assert judged.understated["position"] == pytest.approx(5, rel=0.25)
    np.testing.assert_allclose(
        judged.priors[5].sigmas / priors[5].sigmas, [1, 1, 1, *[judged.understated["position"]] * 2, 1]
    )
    assert [(fix.scan, fix.kind) for fix in judged.wrong] == [(9, "position")]


def test_positions_with_exchanged_axes_are_all_ignored() -> None:
    priors = {}
    for k, prior in fixes(6).items():
        T = prior.T_world_sensor
        priors[k] = replace(prior, T_world_sensor=RigidTransform.from_components(T.translation[[1, 0, 2]], T.rotation))
    judged = judge_fixes(PoseGraph(Trajectory(np.arange(float(COUNT)), TRUTH), edges(6)), priors)
    assert list(judged.understated) == ["position"]
    assert judged.understated["position"] >= NOTHING
    assert judged.wrong == ()
    assert not any(prior.knows_position for prior in judged.priors.values())
    assert all(prior.knows_heading and prior.knows_depth for prior in judged.priors.values())


LANES = 40


def lanes() -> RigidTransform:
    """A lane to the East, a turn, and a lane back, 3 m from pose to pose."""
    k = np.arange(LANES)
    half, turned = LANES // 2, k >= LANES // 2
    places = np.column_stack(
        [3.0 * np.where(turned, LANES - 1 - k, k), np.where(turned, 12.0, 0.0), np.full(LANES, -5.0)]
    )
    yaws = np.where(turned, np.pi, 0.0) + np.where(k == half, -0.6, 0.0)
    return RigidTransform.from_components(places, Rotation.from_euler("Z", yaws[:, None]))


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("error", "shared", "tolerance"),
    [
        ("arm", {0: 6.0, 1: -2.0}, 0.8),
        ("turn", {2: np.radians(12.0)}, 0.05),
        ("late", {3: 1.5}, 0.25),
        ("drift", {4: -0.08, 5: 0.05}, 0.04),
        ("scale", {6: 0.05}, 0.02),
        ("arm and turn", {0: 6.0, 1: -2.0, 2: np.radians(12.0)}, [0.8, 0.8, 0.05]),
        ("none", {}, 0.0),
    ],
)
def test_systematic_error_is_estimated_and_corrected(
    error: str, shared: dict[int, float], tolerance: float | list[float]
) -> None:
    """A lever arm of the wrong sign, headings by another North, a clock that is late, places that drift, ranges that
    are too long, on lanes there and back with a loop between them, which tell these apart."""
    seed = 2
    truth, rng = lanes(), np.random.default_rng([seed, 7])
    errors = drawn(np.random.default_rng(seed), COVARIANCE, LANES)
    loops = np.random.default_rng([seed, 8])
    across = [measured_edge(loops, truth, k, LANES - 1 - k, COVARIANCE) for k in range(0, LANES // 2, 5)]
    edges = (*chain_edges(truth, COVARIANCE, errors[:-1]), *across)
    velocities = np.gradient(truth.translation, axis=0)
    priors = {}
    for k in range(LANES):
        arm = truth[k].rotation.apply([-6.0, 2.0, 0.0])
        off = {
            "arm": arm,
            "arm and turn": arm,
            "late": -1.5 * velocities[k],
            "drift": (k - LANES / 2) * np.array([0.08, -0.05, 0.0]),
            "scale": 0.05 * (truth.translation.mean(axis=0) - truth[k].translation),
        }.get(error, np.zeros(3))
        turn = Rotation.from_euler("Z", -12.0 if "turn" in error else 0.0, degrees=True)
        T = RigidTransform.from_components(truth[k].translation + off, turn * truth[k].rotation)
        priors[k] = unexact(T, rng, SIGMAS)
    judged = judge_fixes(PoseGraph(Trajectory(np.arange(float(LANES)), truth), edges), priors)
    found = judged.systematic
    if error == "none":
        assert found is None
        return
    assert found is not None
    assert found.alternative is None
    assert np.flatnonzero(found.numbers).tolist() == list(shared)
    assert (np.abs(found.numbers[list(shared)] - list(shared.values())) <= tolerance).all()
    assert judged.wrong == ()
    apart = np.array([judged.priors[k].T_world_sensor.translation - truth[k].translation for k in range(LANES)])
    assert np.abs(np.median(apart, axis=0)).max() < 0.8


RING = 30


LOOP = np.diag([0.01, 0.015, 0.02, 0.05, 0.06, 0.04]) ** 2


def ring(seed: int) -> PoseGraph:
    """A chain with a loop every few poses, one of them off by several sigmas."""
    rng = np.random.default_rng(seed)
    step = RigidTransform.from_exp_coords([0.02, -0.03, 2 * np.pi / RING, 1.0, 0.1, -0.05])
    T = RigidTransform.concatenate(list(accumulate([step] * (RING - 1), mul, initial=RigidTransform.identity())))
    pairs = [(k, k + 1) for k in range(RING - 1)] + [(0, 29), (2, 27), (4, 25), (6, 9), (10, 14), (3, 26)]
    edges = []
    for i, j in pairs:
        off = rng.multivariate_normal(np.zeros(6), LOOP)
        off += 7 * np.array([0.01, 0, 0, 0, 0.06, 0]) * ((i, j) == (6, 9))
        noise = RigidTransform.from_exp_coords(off)
        edges.append(edge(i, j, T[i].inv() * T[j] * noise, LOOP, "sequential" if j == i + 1 else "loop"))
    return chained_graph(edges, RING)


def test_edge_beyond_the_bound_is_contradicted_and_an_only_edge_never() -> None:
    graph = ring(0)
    solution = graph.optimize()
    graph = graph.at(solution.trajectory.T_world_sensor)
    loops = np.array([one.kind == "loop" for one in graph.edges])
    residuals = graph.residuals() ** 2
    worst = int(np.argmax(np.where(loops, residuals, 0)))
    assert contradicted_edges(graph, solution, loops, residuals[worst] * 0.99).tolist() == [worst]
    assert contradicted_edges(graph, solution, np.zeros_like(loops), 0.1).tolist() == []
    # the only tie is contradicted by nothing
    graph = ring(1).keep(np.arange(RING + 5) < RING - 1)  # a chain
    solution = graph.optimize()
    graph = graph.at(solution.trajectory.T_world_sensor)
    assert contradicted_edges(graph, solution, np.ones(RING - 1, bool), 1.0, 1.0).tolist() == []


def test_positions_do_not_bound_the_search_and_other_sigmas_are_scaled() -> None:
    priors = fixes(5, known=slice(3, 6))
    points = np.zeros((1, 3), np.float32)
    scans = [Scan(points, stamp=float(k), prior=priors[k], name=f"scan{k}") for k in range(COUNT)]
    given = Measurements(tuple(scans), np.zeros(COUNT, int), Odometry(np.arange(COUNT), TRUTH, np.arange(float(COUNT))))
    for understated, times in ({}, 1), ({"depth": 3.0, "attitude": 2.0}, 3):
        kept = given.searched(understated)[20].prior
        assert kept is not None
        np.testing.assert_allclose(kept.sigmas, [np.inf] * 5 + [times * SIGMAS[5]])
    assert given.scans == tuple(scans)
    assert len(given.steps) == COUNT - 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_run_of_wrong_fixes_is_no_systematic_error(seed: int) -> None:
    """On lanes without loops, whose steps are unsure: with two of them broken and a lever arm all fixes would fit."""
    truth, rng = lanes(), np.random.default_rng([seed, 9])
    unsure, sigmas = 50 * COVARIANCE, SIGMAS * [1, 1, 1, 0.5, 0.5, 1]
    edges = tuple(chain_edges(truth, unsure, drawn(np.random.default_rng(seed), unsure, LANES)[:-1]))
    wrong, way = range(8, 21), rng.uniform(0, 2 * np.pi)
    priors = {}
    for k in range(LANES):
        off = 24.0 * np.array([np.cos(way), np.sin(way), 0.0]) * (k in wrong)
        priors[k] = unexact(RigidTransform.from_translation(off) * truth[k], rng, sigmas)
    judged = judge_fixes(PoseGraph(Trajectory(np.arange(float(LANES)), truth), edges), priors)
    assert judged.systematic is None
    assert [fix.scan for fix in judged.wrong if fix.kind == "position"] == list(wrong)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_contradicted_edges_are_those_whose_removal_lowers_chi_squared(seed: int) -> None:
    graph = ring(seed)
    solution = graph.optimize()
    graph = graph.at(solution.trajectory.T_world_sensor)
    loops = np.array([one.kind == "loop" for one in graph.edges])
    falls = {}
    for k in np.flatnonzero(loops).tolist():
        without = graph.keep(np.arange(len(loops)) != k).optimize().chi_squared_after
        falls[k] = solution.chi_squared_after - without
    bound = chi_squared(0.999, 6)
    assert (graph.residuals()[loops] ** 2 < bound).all()  # none is far off by itself
    for limit in (0.3 * max(falls.values()), 0.9 * max(falls.values())):
        understated = max(1.0, float(np.median(list(falls.values()))) / chi_squared(0.5, 6))
        limit = max(limit / understated, float((graph.residuals()[loops] ** 2).max()) + 1e-9)
        expected = [k for k, fall in falls.items() if fall > limit * understated]
        clear = all(abs(fall / limit / understated - 1) > 0.05 for fall in falls.values())
        if clear:
            assert contradicted_edges(graph, solution, loops, limit, limit).tolist() == expected
