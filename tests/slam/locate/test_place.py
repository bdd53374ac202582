"""Places that answers agree on: agreement makes a place more probable, contradiction less."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.locate.place import Place, agreed_places

COVARIANCE = np.diag(np.repeat([0.01, 0.1], 3) ** 2)
FLOOR = np.repeat([0.01, 0.1], 3)


def answer(x: float, probability: float, key: int, yaw: float = 0.0) -> Place:
    T = RigidTransform.from_components([x, 0, 0], Rotation.from_euler("z", yaw))
    return Place(T, COVARIANCE, probability, (key,))


def test_answers_that_agree_make_a_place_more_probable() -> None:
    places = agreed_places([answer(0, 0.8, 1), answer(0.2, 0.7, 2), answer(0.1, 0.6, 3)], FLOOR)
    assert len(places) == 1
    assert places[0].probability == pytest.approx(1 - 0.2 * 0.3 * 0.4)
    assert places[0].keys == (1, 2, 3)
    assert places[0].T_map_scan.translation[0] == 0  # that of the most probable answer


def test_a_key_scan_counts_once() -> None:
    (place,) = agreed_places([answer(0, 0.8, 1), answer(0.1, 0.7, 1)], FLOOR)
    assert place.probability == pytest.approx(0.8)


@pytest.mark.parametrize("other", [answer(5, 0.9, 2), answer(0, 0.9, 2, yaw=0.5)])
def test_of_two_equally_probable_places_none_has_more_than_a_half(other: Place) -> None:
    places = agreed_places([answer(0, 0.9, 1), other, answer(0.1, 0.9, 3), answer(5, 0.9, 4)], FLOOR)
    assert len(places) >= 2
    assert sum(place.probability for place in places) <= 1
    equal = agreed_places([answer(0, 0.999, 1), other, *(answer(0, 0.999, k) for k in (3, 4))], FLOOR)
    assert equal[0].keys == (1, 3, 4)
    assert agreed_places([answer(0, 0.9, 1), other], FLOOR)[0].probability < 0.5


def test_answers_agree_along_an_unconstrained_direction() -> None:
    loose = Place(RigidTransform.from_translation([3, 0, 0]), COVARIANCE + np.diag([0, 0, 0, 4.0, 0, 0]), 0.5, (2,))
    assert len(agreed_places([answer(0, 0.9, 1), loose], FLOOR)) == 1
    aside = Place(RigidTransform.from_translation([0, 3, 0]), loose.covariance, 0.5, (2,))
    assert len(agreed_places([answer(0, 0.9, 1), aside], FLOOR)) == 2
    assert agreed_places([], FLOOR) == []
