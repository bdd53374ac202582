"""The index of signatures: distances, and the most similar scans of other components."""

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.candidates import find_lookalikes
from sonarmap.slam.candidates.places import PlaceIndex
from sonarmap.slam.candidates.settings import LoopSettings

PLACES = 30  # of a lap; a survey has two laps
NUMBERS = 40  # of a signature


def laps(seed: int, noise: float = 0.2, count: int = 2) -> np.ndarray:
    """(count PLACES, NUMBERS): signatures of `count` laps over the same places, with noise."""
    rng = np.random.default_rng(seed)
    once = np.cumsum(rng.normal(size=(PLACES, NUMBERS)), axis=0)
    return np.tile(once, (count, 1)) + noise * rng.normal(size=(count * PLACES, NUMBERS))


def all_distances(given: np.ndarray, surveys: np.ndarray | None = None) -> np.ndarray:
    """(N, N) distances of all scans; infinite up to five scans before and after."""
    order = np.arange(len(given))
    distances = PlaceIndex(given, surveys).distances(order, order)
    distances[np.abs(order[:, None] - order) <= 5] = np.inf
    return distances


def test_unit_and_origin_of_the_signatures_do_not_matter():
    given = laps(7)
    np.testing.assert_allclose(all_distances(given * 250 - 17), all_distances(given), rtol=1e-6)


def test_finds_revisits_despite_noise_in_some_columns():
    """Loud noise in columns that do not depend on the place misleads plain distances."""
    rng = np.random.default_rng(8)
    given = np.column_stack([laps(8), 15 * rng.normal(size=(2 * PLACES, 6))])
    order = np.arange(2 * PLACES)
    plain = np.linalg.norm(given[:, None] - given, axis=2)
    plain[np.abs(order[:, None] - order) <= 5] = np.inf

    def share_near(distances):
        return np.mean(np.abs(distances.argmin(axis=1) - (order + PLACES) % (2 * PLACES)) <= 2)

    assert share_near(plain) < 0.4
    assert share_near(all_distances(given)) > 0.6


def test_most_like_agrees_with_all_distances():
    """The scan most like a scan of the index is itself; its neighbors follow in their order."""
    given = laps(7)
    places, order = PlaceIndex(given), np.arange(2 * PLACES)
    for k in (0, 31, 59):
        wanted = np.argsort(places.distances(np.array([k]), order)[0], kind="stable")
        np.testing.assert_array_equal(places.most_like(given[k]), wanted)
        assert wanted[0] == k
    np.testing.assert_array_equal(PlaceIndex(given[:1]).most_like(given[5]), [0])


def test_the_step_between_two_surveys_teaches_nothing():
    given = laps(10)
    given[PLACES:] += 100.0
    of_two, of_one = (all_distances(given, surveys) for surveys in (np.repeat([0, 1], PLACES), None))
    assert np.median(of_two[0, PLACES:] / of_two[0, 10:PLACES].mean()) > np.median(
        of_one[0, PLACES:] / of_one[0, 10:PLACES].mean()
    )


def test_lookalikes_are_the_nearest_scans_of_other_components():
    given, surveys = laps(9), np.repeat([0, 1], PLACES)
    parts = [range(PLACES), range(PLACES, 2 * PLACES)]
    found = find_lookalikes([*given], parts, LoopSettings(per_scan=1, spread=0))
    assert all(surveys[each.i] != surveys[each.j] for each in found)
    assert np.mean([each.j - each.i == PLACES for each in found]) > 0.9
    left_out = {each.scans for each in found}
    assert left_out.isdisjoint(each.scans for each in find_lookalikes([*given], parts, LoopSettings(), left_out))
    distances = PlaceIndex(given, surveys).distances(np.arange(PLACES), np.arange(PLACES, 2 * PLACES))
    for each in found:
        assert each.alike == distances[each.i, each.j - PLACES]
    assert find_lookalikes([*given], [range(2 * PLACES)], LoopSettings()) == []  # there is no other component


@pytest.mark.parametrize(
    ("given", "words"),
    [
        *(((given,), r"wanted \(N, K\)") for given in (np.zeros(4), np.zeros((0, 4)), np.full((3, 2), np.nan))),
        *(((laps(15), surveys), "scans of one survey after those") for surveys in (np.zeros(9), np.arange(60) % 2)),
    ],
)
def test_refuses_signatures_and_surveys_of_wrong_shape(given, words):
    with pytest.raises(InputError, match=words):
        PlaceIndex(*given)
