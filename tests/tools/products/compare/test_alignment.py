"""Which answers of located views agree on one transform."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.tangent import lengths
from sonarmap.tools.products.compare.comparison import agreed
from tests.samples.surveys import drawn

COVARIANCE = np.diag(np.repeat([3e-3, 0.05], 3) ** 2)
TRUTH = RigidTransform.from_exp_coords([0.1, -0.05, 1.2, 8.0, -3.0, 1.0])


def answers(seed: int, count: int, truth: RigidTransform = TRUTH) -> list[tuple[RigidTransform, np.ndarray]]:
    errors = drawn(np.random.default_rng(seed), COVARIANCE, count)
    return [(errors[k] * truth, COVARIANCE) for k in range(count)]


def test_most_answers_decide() -> None:
    wrong = answers(2, 3, RigidTransform.from_translation([30.0, 0, 0]) * TRUTH)
    alignment = agreed([*wrong, *answers(1, 7)], 12)
    assert alignment is not None
    assert (alignment.located, alignment.agreeing, alignment.tried) == (10, 7, 12)
    xi = (TRUTH * alignment.T_old_new.inv()).as_exp_coords()
    assert lengths(xi[None], alignment.covariance[None])[0] < 3
    np.testing.assert_allclose(alignment.covariance, COVARIANCE)


def test_too_few_or_two_places_are_refused() -> None:
    assert agreed([], 5) is None
    assert agreed(answers(1, 1), 5) is None
    elsewhere = answers(2, 3, RigidTransform.from_translation([30.0, 0, 0]) * TRUTH)
    assert agreed([*answers(1, 3), *elsewhere], 8) is None


def test_a_single_view_is_enough_where_there_is_no_other() -> None:
    assert agreed(answers(1, 1), 1) is not None
