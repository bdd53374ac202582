"""Control points in a graph: the factor, the placement of a map, unconstrained motions, and wrong points."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.wrong_control import without_wrong_control
from sonarmap.slam.graph.control import ControlPoint, jacobian
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.place import place_by_control, place_in_world, robust_fit
from sonarmap.slam.graph.pose_covariance import pose_covariances
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.spectral.scan import PosePrior
from tests.samples.surveys import chain_edges, drawn, position_error, random_covariance, ring_poses

T_WORLD = RigidTransform.from_components([310.0, -45.0, -12.0], Rotation.from_euler("ZYX", [2.1, 0.2, -0.1]))
COUNT = 12
TRUTH = T_WORLD * ring_poses(COUNT)
COVARIANCE = random_covariance(np.random.default_rng(4), 0.004, 0.03)
# points of some scans, in their frames [m]
PICKED = {0: [2.0, 1.0, -1.0], 4: [3.0, -2.0, 0.5], 8: [1.5, 2.5, -2.0], 10: [-2.0, 3.0, 1.0], 2: [4.0, 0.0, -3.0]}


def point(scan: int, sigma: float = 0.05, off: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ControlPoint:
    """A point at PICKED whose known position is off by `off`."""
    picked = np.array(PICKED[scan])
    return ControlPoint(f"P{scan}", scan, picked, TRUTH[scan].apply(picked) + off, np.full(3, sigma))


def graph(control: list[ControlPoint], noisy: bool = True, priors: dict[int, PosePrior] | None = None) -> PoseGraph:
    """A chain that was placed by the points."""
    rng = np.random.default_rng(7)
    edges = tuple(chain_edges(TRUTH, COVARIANCE, drawn(rng, COVARIANCE * noisy, COUNT - 1)))
    known = priors or {}
    placed = place_by_control(chain(edges, np.zeros(COUNT)), [range(COUNT)], control, known)
    return PoseGraph(placed, edges, control=tuple(control), priors=tuple(known.items()))


def distance(solution: Solution) -> float:
    return position_error(solution.trajectory.T_world_sensor, TRUTH)


def test_the_residual_matches_a_calculation_by_hand():
    """A sensor at (10, 20, -3) that looks North sees the point 2 m ahead, 1 m to the left and 0.5 m up."""
    T = RigidTransform.from_components([10.0, 20.0, -3.0], Rotation.from_euler("Z", 90, degrees=True))
    known = ControlPoint("A", 0, np.array([2.0, 1.0, 0.5]), np.array([9.1, 21.8, -2.7]), np.array([0.1, 0.4, 0.05]))
    # it is seen at 9, 22 and -2.5: off by -0.1, 0.2 and 0.2, which is 1, 0.5 and 4 sigmas
    poses = to_values(RigidTransform.concatenate([T]))
    assert known.factor().error(poses) == pytest.approx(0.5 * (1.0 + 0.25 + 16.0), rel=1e-9)
    np.testing.assert_allclose(T.apply(known.point) - known.known, [-0.1, 0.2, 0.2], atol=1e-9)


def test_the_jacobian_matches_finite_differences():
    T, p, step = TRUTH[3], np.array([1.2, -0.7, 2.9]), 1e-6
    differences = [((T * RigidTransform.from_exp_coords(step * xi)).apply(p) - T.apply(p)) / step for xi in np.eye(6)]
    np.testing.assert_allclose(jacobian(T, p), np.array(differences).T, atol=1e-5)


def test_three_points_place_a_chain_in_the_world():
    solution = graph([point(0), point(4), point(8)], noisy=False).optimize()
    assert distance(solution) < 1e-4
    assert solution.graph.gauge.unmeasured == {}
    assert solution.graph.anchors == ()
    assert solution.degrees_of_freedom == 6 * (COUNT - 1) + 9 - 6 * COUNT
    noisy = graph([point(0), point(4), point(8), point(10)]).optimize()
    assert distance(noisy) < 0.3
    covariances = pose_covariances(noisy)
    assert (np.linalg.eigvalsh(covariances) > 0).all()
    # between control points, positions stay certain
    spread = np.sqrt(np.trace(covariances[:, 3:, 3:], axis1=1, axis2=2))
    assert spread[6] < 2.0


def test_the_map_moves_with_the_known_coordinates_whatever_their_order():
    control = [point(0), point(4, off=(0.04, -0.03, 0.02)), point(8), point(10, off=(-0.05, 0.01, 0.03))]
    T_other = RigidTransform.from_components([-75.0, 220.0, 4.0], Rotation.from_euler("ZYX", [-1.3, 0.4, 0.9]))
    moved = [replace(each, known=T_other.apply(each.known)) for each in control]
    first, second, turned = (
        graph(points).optimize().trajectory.T_world_sensor for points in (control, moved, control[::-1])
    )
    np.testing.assert_allclose((T_other * first).as_matrix(), second.as_matrix(), atol=2e-4)
    np.testing.assert_allclose(first.as_matrix(), turned.as_matrix(), atol=1e-5)


@pytest.mark.parametrize(
    ("scans", "open_"),
    [((4,), {"tilt_x", "tilt_y", "heading"}), ((0, 8), None), ((0, 4, 8), set())],
)
def test_motions_that_few_points_leave_unconstrained_are_listed_and_held(scans, open_):
    held = graph([point(k) for k in scans], noisy=False)
    names = np.array(["tilt_x", "tilt_y", "heading", "east", "north", "up"])
    flags = held.gauge.unmeasured.get(0, np.zeros(6, bool))
    if open_ is not None:
        assert set(names[flags]) == open_
    else:
        assert 1 <= flags[:3].sum() <= 3
        assert not flags[3:].any()
    solution = held.optimize()
    for each in held.control:
        np.testing.assert_allclose(
            solution.trajectory.T_world_sensor[each.scan].apply(each.point), each.known, atol=1e-3
        )


@pytest.mark.parametrize("upright", [False, True])
def test_a_blunder_does_not_spoil_the_start(upright):
    rng = np.random.default_rng(5)
    R = Rotation.from_euler("Z" if upright else "ZYX", 2.0 if upright else [2.0, -0.4, 0.7])
    T = RigidTransform.from_components([120.0, -30.0, 8.0], R)
    here = rng.normal(size=(6, 3)) * [20, 15, 4]
    there = T.apply(here) + 0.02 * rng.normal(size=(6, 3))
    there[2] += [55.0, -20.0, 3.0]
    fitted = robust_fit(here, there, upright)
    assert float(np.linalg.norm((T.inv() * fitted).translation)) < 0.1
    assert float((T.inv() * fitted).rotation.magnitude()) < 0.01


def test_many_points_need_little_memory():
    here = np.random.default_rng(5).normal(size=(200, 3)) * [20, 15, 4]
    tracemalloc.start()
    try:
        fitted = robust_fit(here, T_WORLD.apply(here))
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()
    np.testing.assert_allclose(fitted.as_matrix(), T_WORLD.as_matrix(), atol=1e-9)


def test_only_wrong_points_are_left_out():
    for size in (1.5, 40.0):
        control = [point(0), point(2), point(4, off=(0.6 * size, -0.8 * size, 0.0)), point(8), point(10)]
        kept, wrong = without_wrong_control(graph(control))
        assert [each.point.name for each in wrong] == ["P4"]
        assert [each.name for each in kept] == ["P0", "P2", "P8", "P10"]
        assert wrong[0].sigmas > 5
    rng = np.random.default_rng(8)
    control = [replace(point(k), known=point(k).known + 0.05 * rng.normal(size=3)) for k in PICKED]
    assert without_wrong_control(graph(control))[1] == ()
    # with three points, the wrong one cannot be identified
    kept, wrong = without_wrong_control(graph([point(0), point(4, off=(9.0, 0.0, 0.0)), point(8)]))
    assert (len(kept), wrong) == (3, ())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"point": np.array([1.0, np.nan, 0.0])}, "finite"),
        ({"known": None}, "not an array of three finite numbers"),
        ({"sigmas": np.array([0.1, 0.0, 0.1])}, "above 0"),
        ({"scan": "a"}, "names scan 'a'; wanted its index"),
        ({"use": np.array(["control", "check"])}, "control or check"),
        ({}, "control point names a pose"),
    ],
)
def test_invalid_points_and_points_of_no_pose_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        PoseGraph(Trajectory(np.zeros(2), TRUTH[:2]), (), control=(replace(point(4), **changes),))


def test_attitudes_and_two_points_are_enough():
    sigmas = np.array([0.003, 0.003, np.inf, np.inf, np.inf, np.inf])
    priors = {k: PosePrior(TRUTH[k], sigmas) for k in range(COUNT)}
    upright = graph([], priors=priors)
    level = place_in_world(upright.trajectory, [range(COUNT)], priors)
    control = (point(0), point(4))
    placed = place_by_control(level, [range(COUNT)], control, priors)
    solution = PoseGraph(placed, upright.edges, priors=tuple(priors.items()), control=control).optimize()
    assert solution.graph.gauge.unmeasured == {}
    assert distance(solution) < 0.4
    alone = PoseGraph(placed, upright.edges, priors=tuple(priors.items()), control=control[:1])
    assert alone.gauge.unmeasured[0].tolist() == [False, False, True, False, False, False]


def test_points_on_a_line_leave_the_rotation_about_it_unconstrained():
    line = np.linspace(0, 1, 3)[:, None] * [20.0, 6.0, 1.0] + T_WORLD.translation
    control = [
        ControlPoint(f"L{k}", k, TRUTH[k].inv().apply(place), place, np.full(3, 0.05))
        for k, place in zip((0, 4, 8), line, strict=True)
    ]
    assert graph(control).gauge.unmeasured[0][:3].any()
    aside = replace(control[1], known=control[1].known + np.array([0.01, 0.0, 0.0]))
    assert graph([control[0], aside, control[2]]).gauge.unmeasured[0][:3].any()
