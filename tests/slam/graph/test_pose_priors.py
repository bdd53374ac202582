"""What instruments say of poses, in the graph: each part with its own noise, and what none tells is held."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.place import place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.spectral.measured import twist
from sonarmap.spectral.scan import PosePrior
from tests.samples.surveys import chain_edges, chained_graph, drawn, random_covariance, ring_poses

SIGMAS = np.array([0.004, 0.007, 0.02, 0.5, 0.8, 0.05])
T_WORLD = RigidTransform.from_components([310.0, -45.0, -12.0], Rotation.from_euler("ZYX", [2.1, 0.2, -0.1]))


def ring(count: int, seed: int = 0) -> tuple[RigidTransform, list[Edge]]:
    """True poses somewhere in the world, and a chain of edges between them, with noise."""
    truth = T_WORLD * ring_poses(count)
    rng = np.random.default_rng(seed)
    covariance = random_covariance(rng, 0.004, 0.03)
    return truth, chain_edges(truth, covariance, drawn(rng, covariance, count - 1))


def told(T: RigidTransform, *known: str) -> PosePrior:
    """A prior without an error, of attitude, heading, position or depth."""
    names = ("attitude", "attitude", "heading", "position", "position", "depth")
    return PosePrior(T, np.where([name in known for name in names], SIGMAS, np.inf))


def graph(edges: list[Edge], priors: dict[int, PosePrior], count: int) -> PoseGraph:
    start = place_in_world(chain(edges, np.zeros(count)), [range(count)], priors)
    return PoseGraph(start, tuple(edges), priors=tuple(priors.items()))


@pytest.mark.parametrize("row", range(6))
def test_each_error_counts_with_its_own_sigma(row):
    """One pose alone, held against another prior far tighter: chi-squared is the error over its sigma, squared."""
    measured = T_WORLD
    off = np.zeros(6)
    off[row] = 0.3 * SIGMAS[row]
    w = Rotation.from_euler("Z", twist(measured.rotation)).apply(off[:3])
    true = RigidTransform.from_components(measured.translation + off[3:], Rotation.from_rotvec(w) * measured.rotation)
    held = PoseGraph(
        Trajectory(np.zeros(1), RigidTransform.concatenate([true])), (), (0,), ((0, PosePrior(measured, SIGMAS)),)
    )
    assert held.optimize().chi_squared_after == pytest.approx(0.09, rel=1e-3)


def test_an_unmeasured_heading_has_no_say():
    """The tilt that is measured counts alike, whatever turn about the vertical the prior's pose holds."""
    truth, edges = ring(5)
    results = []
    for turn in (0.0, 1.7):
        turned = RigidTransform.from_rotation(Rotation.from_euler("Z", turn)) * truth
        priors = {k: told(turned[k], "attitude", "position", "depth") for k in range(5)}
        priors = {
            k: PosePrior(RigidTransform.from_components(truth[k].translation, p.T_world_sensor.rotation), p.sigmas)
            for k, p in priors.items()
        }
        results.append(graph(edges, priors, 5).optimize())
    first, second = (solution.trajectory.T_world_sensor for solution in results)
    np.testing.assert_allclose((first.inv() * second).as_exp_coords(), 0, atol=2e-5)
    assert results[0].chi_squared_after == pytest.approx(results[1].chi_squared_after, rel=1e-3)


@pytest.mark.parametrize(
    ("known", "free", "level"),
    [
        (("attitude", "heading", "position", "depth"), 0, 0),
        (("attitude", "depth"), 3, 0),
        (("heading",), 5, 0),
        (("position",), 3, 0),
        (("position", "depth"), 0, 2),
    ],
)
def test_what_no_instrument_tells_is_held(known, free, level):
    """Where positions alone tell the tilt, that vehicles float about level is two numbers more."""
    truth, edges = ring(6)
    priors = {k: told(truth[k], *known) for k in (0, 2, 3, 5)}
    one = graph(edges, priors, 6)
    assert sum(int(held.sum()) for _, held in one.gauge.unconstrained) == free
    assert one.anchors == ()
    solution = one.optimize()
    measured = 30 + 4 * sum({"attitude": 2, "heading": 1, "position": 2, "depth": 1}[name] for name in known)
    assert solution.degrees_of_freedom == measured + level - (36 - free)
    assert solution.chi_squared_after <= solution.chi_squared_before
    assert np.isfinite(solution.covariances()).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_vehicle_that_hardly_moves_is_about_level(seed):
    """Positions of 3 m along a line of 2.5 m tell any roll."""
    leveled = RigidTransform.from_components(0.5 * np.outer(np.arange(6), [1.0, 0.3, 0.05]), Rotation.identity(6))
    truth = RigidTransform.from_rotation(Rotation.from_euler("ZYX", [2.1, 0.05, -0.05])) * leveled
    edges = chain_edges(truth, 1e-6 * np.eye(6))
    rng = np.random.default_rng(seed)
    sigmas = np.array([np.inf, np.inf, 0.05, 3.0, 3.0, 0.1])
    off = [RigidTransform.from_translation(rng.normal(size=3) * sigmas[3:]) for _ in range(6)]
    priors = {k: PosePrior(off[k] * truth[k], sigmas) for k in range(6)}
    solution = graph(edges, priors, 6).optimize()
    turned = (truth.rotation.inv() * solution.trajectory.T_world_sensor.rotation).magnitude()
    assert np.rad2deg(turned).max() < 12
    assert np.rad2deg(np.sqrt(solution.covariances()[:, 0, 0])).max() > 3


def test_priors_bring_the_chain_into_the_world_and_make_it_sure():
    truth, edges = ring(12)
    bare = chained_graph(edges, 12).optimize()
    priors = {k: told(truth[k], "attitude", "heading", "depth", "position") for k in range(12)}
    solution = graph(edges, priors, 12).optimize()
    off = solution.trajectory.T_world_sensor.translation - truth.translation
    assert np.abs(off).max() < 0.3
    assert np.abs(off[:, 2]).max() < 0.05
    # the chain's last pose is surer with every scan's depth and attitude known
    assert solution.covariances()[-1, 0, 0] < bare.covariances()[-1, 0, 0]


def test_a_chain_is_placed_by_headings_or_by_positions():
    truth, _ = ring(8)
    part = Trajectory(np.zeros(8), truth[0].inv() * truth)
    for known in (("attitude", "heading", "position", "depth"), ("attitude", "position", "depth")):
        priors = {k: told(truth[k], *known) for k in (1, 4, 6)}
        placed = place_in_world(part, [range(8)], priors)
        np.testing.assert_allclose((truth.inv() * placed.T_world_sensor).as_exp_coords(), 0, atol=1e-9)
    untouched = place_in_world(part, [range(8)], {})
    np.testing.assert_array_equal(untouched.T_world_sensor.as_matrix(), part.T_world_sensor.as_matrix())
