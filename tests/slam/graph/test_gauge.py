"""The gauge holds unmeasured motions only: laws, on poses of a sonar that looks down."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.place import place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.spectral.scan import PosePrior
from tests.samples.surveys import chain_edges

COUNT = 12
KINDS = {"attitude": [0, 1], "heading": [2], "position": [3, 4], "depth": [5]}
SIGMAS = np.array([0.01, 0.01, 0.05, 0.5, 0.5, 0.1])


def orbit() -> RigidTransform:
    """True poses on an arc of 60 m that rises and falls, of a sensor that looks down by 24 degrees."""
    angle = np.linspace(0.0, 4.0, COUNT)
    places = np.column_stack([30 * np.cos(angle), 30 * np.sin(angle), 3 * np.sin(2.3 * angle) - 8])
    R = Rotation.from_euler(
        "ZYX", np.column_stack([angle + 2.0, np.full(COUNT, np.deg2rad(24.0)), 0.1 * np.sin(angle)])
    )
    return RigidTransform.from_components(places, R)


def solved(truth: RigidTransform, *kinds: str, noise: float = 0.0) -> Solution:
    """The optimum with priors of these kinds, from a chain whose first sensor is level."""
    measured = np.isin(np.arange(6), [number for kind in kinds for number in KINDS[kind]])
    sigmas, rng = np.where(measured, SIGMAS, np.inf), np.random.default_rng(1)
    off = noise * rng.standard_normal((COUNT, 3)) * SIGMAS[3:]
    priors = {k: PosePrior(RigidTransform.from_translation(off[k]) * truth[k], sigmas) for k in range(COUNT)}
    edges = chain_edges(truth, np.diag([0.001] * 3 + [0.02] * 3) ** 2)
    start = place_in_world(chain(edges, np.arange(float(COUNT))), [range(COUNT)], priors)
    solution = PoseGraph(start, tuple(edges), priors=tuple(priors.items())).optimize()
    for _ in range(3):
        solution = solution.graph.optimize()
    return solution


def tilts(T: RigidTransform, truth: RigidTransform) -> np.ndarray:
    """(N,) errors of the vertical [deg]."""
    up, there = (each.rotation.inv().apply([0.0, 0.0, 1.0]) for each in (T, truth))
    return np.degrees(np.arccos(np.clip((up * there).sum(axis=1), -1, 1)))


def shape_error(T: RigidTransform, truth: RigidTransform) -> float:
    """The largest distance between relative poses of the estimate and the true ones [m]."""
    return float(np.abs(((T[0].inv() * T).inv() * (truth[0].inv() * truth)).as_exp_coords()).max())


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("kinds", "open_motions"),
    [
        (["depth"], ["heading", "east", "north"]),
        (["position"], ["up"]),
        (["attitude"], ["heading", "east", "north", "up"]),
        (["attitude", "heading"], ["east", "north", "up"]),
        (["heading", "depth"], ["east", "north"]),
        (["position", "depth"], []),
    ],
)
def test_only_unmeasured_motions_are_held(kinds: list[str], open_motions: list[str]) -> None:
    truth = orbit()
    solution = solved(truth, *kinds)
    flags = solution.graph.gauge.unmeasured.get(0, np.zeros(6, bool))
    assert [name for name, free in zip(MEASURED, flags, strict=True) if free] == open_motions
    T = solution.trajectory.T_world_sensor
    assert solution.chi_squared_after < 1e-3
    assert shape_error(T, truth) < 1e-3
    assert tilts(T, truth).max() < 0.5
    for number, name in ((2, "up"), (0, "east")):
        if name not in open_motions:
            np.testing.assert_allclose(T.translation[:, number], truth.translation[:, number], atol=0.05)
    assert np.isfinite(solution.covariances()).all()
    free = sum(motion.axes.shape[1] for motion in solution.graph.gauge.open_motions.values())
    measured = 6 * (COUNT - 1) + COUNT * sum(len(KINDS[kind]) for kind in kinds)
    assert solution.degrees_of_freedom == measured - (6 * COUNT - free)
    assert solution.graph.anchors == ()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kinds", [["position"], ["depth"], ["position", "depth"]])
def test_errors_of_measurements_do_not_bend_the_map(kinds: list[str]) -> None:
    truth = orbit()
    solution = solved(truth, *kinds, noise=1.0)
    T = solution.trajectory.T_world_sensor
    assert shape_error(T, truth) < 0.15
    sigma = np.degrees(np.sqrt(np.linalg.eigvalsh(solution.covariances()[:, :3, :3])[:, -1]))
    assert (tilts(T, truth) < 3 * sigma + 0.1).all()


@pytest.mark.parametrize("kinds", [["depth"], ["position"], ["attitude", "depth"]])
@pytest.mark.quick_cases(1)
def test_turning_and_moving_the_world_turns_and_moves_the_map(kinds: list[str]) -> None:
    """Turned about the vertical, to which priors' errors refer: shape, chi-squared and unconstrained motions stay."""
    T_other = RigidTransform.from_components([400.0, -90.0, 20.0], Rotation.from_euler("Z", 2.2))
    truth = orbit()
    here, there = (solved(T, *kinds) for T in (truth, T_other * truth))
    T_here, T_there = (each.trajectory.T_world_sensor for each in (here, there))
    np.testing.assert_allclose(tilts(T_here, T_there), 0, atol=0.2)  # [deg]; held motions stay near the start
    assert shape_error(T_here, T_there) < 1e-3
    assert here.degrees_of_freedom == there.degrees_of_freedom
    ranks = ([motion.axes.shape for motion in each.graph.gauge.open_motions.values()] for each in (here, there))
    assert next(ranks) == next(ranks)


@pytest.mark.slow
def test_a_straight_track_does_not_measure_roll() -> None:
    """Positions and depths along a line leave the rotation about it unconstrained; the map is not turned over."""
    places = np.outer(np.arange(COUNT), [4.0, 1.0, 0.2])
    truth = RigidTransform.from_components(places, Rotation.from_euler("Z", np.full((COUNT, 1), 0.25)))
    solution = solved(truth, "position", "depth", noise=1.0)
    assert solution.graph.gauge.open_motions[0].axes.shape == (6, 1)
    assert solution.graph.gauge.unmeasured[0][:2].all()
    assert tilts(solution.trajectory.T_world_sensor, truth).max() < 20


@pytest.mark.parametrize("sigma", [1e-3, 0.4, 1.0])
def test_a_measured_turn_is_used_however_uncertain(sigma: float) -> None:
    """Files of other programs have priors with information 1."""
    truth = orbit()
    edges = tuple(chain_edges(truth, np.diag([0.001] * 3 + [0.02] * 3) ** 2))
    off = RigidTransform.from_components([1.0, -2.0, 0.5], Rotation.from_rotvec([0.1, -0.2, 0.6]))
    known = KnownPose(0, truth[0], np.eye(6) / sigma**2)
    solution = PoseGraph(Trajectory(np.arange(float(COUNT)), off * truth), edges, known=(known,)).optimize()
    assert not solution.graph.gauge.unmeasured
    np.testing.assert_allclose((truth.inv() * solution.trajectory.T_world_sensor).as_exp_coords(), 0, atol=1e-4)
