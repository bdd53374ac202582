"""How many edges lie between two scans."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from slam.graph.edge import Edge
from slam.loops import separation
from slam.loops.separation import separations
from tests.samples.surveys import edge

T, COVARIANCE = RigidTransform.identity(), np.eye(6)
CHAIN: list[Edge] = [edge(k, k + 1, T, COVARIANCE) for k in range(9)]


@pytest.mark.parametrize("together", [1, 500])
def test_it_is_counted_along_the_shortest_way(together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(separation, "_TOGETHER", together)
    pairs = np.array([(0, 9), (2, 3), (7, 1), (0, 9)])
    np.testing.assert_array_equal(separations(10, CHAIN, pairs), [9, 1, 6, 9])
    loop = edge(1, 8, T, COVARIANCE, "loop")
    np.testing.assert_array_equal(separations(10, [*CHAIN, loop], pairs), [3, 1, 2, 3])


def test_what_nothing_joins_is_infinitely_far_apart() -> None:
    apart = separations(11, CHAIN, np.array([(0, 10), (3, 4)]))
    np.testing.assert_array_equal(apart, [np.inf, 1])
