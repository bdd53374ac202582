"""Log odds quadratic in the clues."""

import json

import numpy as np
import pytest

from sonarmap.spectral.judgement import Odds


def odds(weights: list[float]) -> Odds:
    ranges = np.array([[-2.0, 0.0], [2.0, 5.0], [0.5, 1.0], [2.0, 0.5]])
    return Odds(("a", "b"), *ranges, constant=0.3, weights=np.array(weights))


def test_they_are_a_quadratic_form_within_the_range_of_the_clues() -> None:
    found = odds([1.0, -2.0, 0.5, 0.25, -1.0])
    assert found.terms == ["a", "b", "a a", "a b", "b b"]
    x, y = (1.5 - 0.5) / 2.0, (2.0 - 1.0) / 0.5
    assert found.of(np.array([[1.5, 2.0]]))[0] == pytest.approx(0.3 + x - 2 * y + 0.5 * x * x + 0.25 * x * y - y * y)
    beyond = found.of(np.array([[9.0, 7.0], [2.0, 5.0]]))
    assert beyond[0] == beyond[1]


def test_json_round_trip() -> None:
    found = odds([1.0, -2.0, 0.5, 0.25, -1.0])
    back = Odds.from_json(json.loads(json.dumps(found.to_json())))
    clues = np.random.default_rng(0).normal(size=(20, 2))
    np.testing.assert_allclose(back.of(clues), found.of(clues), atol=1e-3)
