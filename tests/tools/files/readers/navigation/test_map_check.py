"""Mistakes in navigation that all pairs of a map together show, where each alone shows little."""

import numpy as np
import pytest

from sonarmap.slam.decide.wrong_measurements import judge_fixes
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.place import place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import chain
from sonarmap.spectral.result import Registration
from sonarmap.tools.files.readers.navigation.contradictions import Contradiction, contradiction_of_map
from tests.tools.files.readers.navigation.test_contradictions import SIGMAS, TIGHT, drawn, measured, priors, registered

FEET = np.array([1, 1, 1, 1, 1, 1 / 0.3048])
TURNED = np.array([1, 1, -1, 1, 1, 1])
LEVEL = np.array([1, 1, 0, 0, 0, 1], bool)
DEPTH, ROTATION = np.arange(6) == 5, np.arange(6) < 3


def named(
    values: np.ndarray, truth: np.ndarray, rng: np.random.Generator
) -> tuple[dict[str, float], Contradiction | None]:
    """What errs more than stated beside the edges of a small map, and the mistake."""
    pairs = registered(truth, rng)
    edges = tuple(
        Edge(i, j, Registration(T, TIGHT, 90.0, 0.5, True, 0.0), "loop" if j > i + 1 else "sequential")
        for i, j, T in zip(pairs.i.tolist(), pairs.j.tolist(), pairs.T_i_j, strict=True)
    )
    given = priors(values)
    known = {k: prior for k, prior in enumerate(given) if prior is not None}
    placed = place_in_world(chain(edges, np.arange(len(truth), dtype=float)), (tuple(range(len(truth))),), known)
    judged = judge_fixes(PoseGraph(placed, edges), known)
    graph = PoseGraph(placed, edges, priors=tuple(sorted(judged.priors.items())))
    at = graph.optimize().graph
    return dict(judged.understated), contradiction_of_map(at, given, list(judged.understated))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
@pytest.mark.parametrize(
    ("known", "by", "kind", "instead"),
    [(DEPTH, FEET, "depth", "depths in feet"), (ROTATION, TURNED, "heading", "heading_deg with the opposite sign")],
)
def test_a_map_names_the_mistake(known: np.ndarray, by: np.ndarray, kind: str, instead: str, seed: int) -> None:
    rng, truth = drawn([14, seed])
    truth[:, :2] *= 0.3
    understated, mistake = named(by * measured(truth, rng, known), truth, rng)
    assert understated[kind] > 3
    assert mistake is not None
    assert instead in mistake.instead
    assert mistake.remedies(1.0)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("known", [LEVEL, DEPTH, ROTATION])
@pytest.mark.quick_cases(1)
def test_noise_is_not_named_as_a_mistake(known: np.ndarray, seed: int) -> None:
    rng, truth = drawn([15, seed])
    truth[:, :2] *= 0.3
    values = np.where(known, truth + 4 * rng.normal(size=truth.shape) * SIGMAS, np.nan)
    assert named(values, truth, rng)[1] is None
