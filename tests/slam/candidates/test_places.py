"""The index of signatures: the nearest scans, their order, and the scans that are left out."""

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.places import PlaceIndex

PLACES = 30  # of a lap; a survey has two laps
NUMBERS = 40  # of a signature


def laps(seed: int, noise: float = 0.2, count: int = 2) -> np.ndarray:
    """(count PLACES, NUMBERS): signatures of `count` laps over the same places, with noise."""
    rng = np.random.default_rng(seed)
    once = np.cumsum(rng.normal(size=(PLACES, NUMBERS)), axis=0)
    return np.tile(once, (count, 1)) + noise * rng.normal(size=(count * PLACES, NUMBERS))


class TestNearest:
    @pytest.mark.parametrize("gap", [0, 1, 7])
    def test_leaves_out_scans_within_the_gap(self, gap):
        given = laps(2, count=1)
        index, _ = PlaceIndex(given).nearest(4, gap=gap)
        assert np.abs(index - np.arange(len(given))[:, None]).min() == gap + 1

    def test_agrees_with_all_distances(self):
        """All distances are those of `candidates` that keep every pair."""
        given = laps(3)
        count = len(given)
        everything = PlaceIndex(given).candidates(count, gap=0)
        assert len(everything) == count * (count - 1) // 2
        distances = np.full((count, count), np.inf)
        for i, j, distance in everything:
            distances[i, j] = distances[j, i] = distance
        order = np.arange(count)
        distances[np.abs(order[:, None] - order) <= 5] = np.inf
        index, distance = PlaceIndex(given).nearest(6)
        np.testing.assert_array_equal(index, np.argsort(distances, axis=1, kind="stable")[:, :6])
        np.testing.assert_allclose(distance, np.sort(distances, axis=1)[:, :6], rtol=1e-12)

    def test_unit_and_origin_of_the_signatures_do_not_matter(self):
        given = laps(7)
        want, distance = PlaceIndex(given).nearest(5)
        got, again = PlaceIndex(given * 250 - 17).nearest(5)
        np.testing.assert_array_equal(got, want)
        np.testing.assert_allclose(again, distance, rtol=1e-6)

    def test_finds_revisits_despite_noise_in_some_columns(self):
        """Loud noise in columns that do not depend on the place misleads plain distances."""
        rng = np.random.default_rng(8)
        given = np.column_stack([laps(8), 15 * rng.normal(size=(2 * PLACES, 6))])
        order = np.arange(2 * PLACES)
        plain = np.linalg.norm(given[:, None] - given, axis=2)
        plain[np.abs(order[:, None] - order) <= 5] = np.inf
        index, _ = PlaceIndex(given).nearest(1)

        def share_near(found):
            return np.mean(np.abs(found - (order + PLACES) % (2 * PLACES)) <= 2)

        assert share_near(plain.argmin(axis=1)) < 0.4
        assert share_near(index[:, 0]) > 0.6

    def test_most_like_agrees_with_nearest(self):
        """The scan most like a scan of the index is itself; its neighbors follow in their order."""
        given = laps(7)
        places, count = PlaceIndex(given), len(given)
        index, _ = places.nearest(count - 1, gap=0)
        for k in (0, 31, 59):
            np.testing.assert_array_equal(places.most_like(given[k]), [k, *index[k][index[k] >= 0]])
        np.testing.assert_array_equal(PlaceIndex(given[:1]).most_like(given[5]), [0])

    def test_ties_keep_the_order_of_the_scans(self):
        same = np.tile([1.0, 2, 3, 4, 5], (12, 1))
        index, distance = PlaceIndex(same).nearest(3, gap=2)
        np.testing.assert_array_equal(index[[0, 1, 5]], [[3, 4, 5], [4, 5, 6], [0, 1, 2]])
        assert not distance.any()

    def test_missing_neighbors_are_marked(self):
        index, distance = PlaceIndex(laps(5)[:8]).nearest(4, gap=5)
        np.testing.assert_array_equal(index[0, 2:], [-1, -1])
        np.testing.assert_array_equal(index[3], [-1] * 4)
        assert np.isinf(distance[index < 0]).all()
        assert np.isfinite(distance[index >= 0]).all()
        for count in (1, 2, 3):
            index, _ = PlaceIndex(laps(6)[:count]).nearest(2, gap=0)
            assert index.shape == (count, 2)
            assert (index >= 0).sum() == count * min(2, count - 1)


class TestSurveys:
    def test_elsewhere_searches_other_surveys_only(self):
        surveys = np.repeat([3, 7], PLACES)
        index, distance = PlaceIndex(laps(9), surveys).nearest(2, elsewhere=True)
        assert (surveys[index] != surveys[:, None]).all()
        assert np.mean(index[:, 0] == (np.arange(2 * PLACES) + PLACES) % (2 * PLACES)) > 0.9
        assert np.isfinite(distance).all()

    def test_the_gap_ends_with_the_survey(self):
        given = laps(10)
        given[PLACES] = given[PLACES - 1]  # the second survey begins where the first ends
        index, _ = PlaceIndex(given, np.repeat([0, 1], PLACES)).nearest(1)
        assert index[PLACES, 0] == PLACES - 1
        assert PlaceIndex(given).nearest(1)[0][PLACES, 0] != PLACES - 1
        # a single survey has no others
        index, distance = PlaceIndex(laps(11)).nearest(2, elsewhere=True)
        assert (index == -1).all()
        assert np.isinf(distance).all()


class TestCandidates:
    def test_contains_each_near_pair_once_in_order(self):
        given = laps(12)
        places = PlaceIndex(given)
        index, distance = places.nearest(2)
        found = places.candidates(2)
        assert found == sorted(found)
        assert all(i < j for i, j, _ in found)
        want = {tuple(sorted((i, int(j)))) for i in range(len(given)) for j in index[i]}
        assert {(i, j) for i, j, _ in found} == want
        assert len(found) == len(want)
        assert (0, int(index[0, 0]), float(distance[0, 0])) in found
        assert PlaceIndex(given).candidates(2) == found
        # no candidates if all scans are within the gap
        assert PlaceIndex(laps(14)[:5]).candidates(3) == []


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


@pytest.mark.parametrize(("k", "gap"), [(0, 5), (3, -1)])
def test_refuses_k_and_gap_out_of_range(k, gap):
    with pytest.raises(InputError, match="wanted at least 1 and at least 0"):
        PlaceIndex(laps(16)).nearest(k, gap)
