"""Height differences of lines where they cross."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.crossings import crossings
from sonarmap.slam.pings.line import PingLine
from tests.slam.pings.simulated_lines import simulated


def plane(name: str, seed: int, higher: float = 0.0, east: float = 0.0) -> PingLine:
    """Soundings of a steep plane, z = 0.5 East - 0.3 North - 10, strewn over 10 m x 10 m to the right of a track."""
    rng = np.random.default_rng(seed)
    stamps = np.arange(100.0)
    places = np.column_stack([np.full(100, east), stamps / 10, np.zeros(100)])
    pings = np.repeat(np.arange(100), 60)
    x, y = rng.uniform(-0.05, 0.05, 6000), -rng.uniform(0, 10, 6000)
    z = 0.5 * (east - y) - 0.3 * (places[pings, 1] + x) - 10 + higher
    level = np.zeros((100, 3))
    return PingLine(name, stamps, places, level, level, pings, np.column_stack([x, y, z]))


class TestCrossings:
    def test_a_slope_makes_no_difference_and_the_first_is_higher(self) -> None:
        seen = crossings([plane("a", 1, higher=0.25), plane("b", 2, east=-2.37)], cell=1.0)
        assert seen.cells > 60
        assert (seen.all.count, seen.all.spread) == (seen.cells, pytest.approx(0, abs=1e-9))
        ((first, second, own),) = seen.by_lines
        assert (first, second, own.count) == ("a", "b", seen.cells)
        assert own.mean == pytest.approx(0.25)
        assert {"first", "second", "count", "mean_m"} <= set(seen.to_json()["by_lines"][0])

    @pytest.mark.slow
    def test_true_lines_agree_within_their_noise_and_wrong_ones_do_not(self) -> None:
        survey = simulated(5, pings=160, beams=64)
        true, recorded = crossings(survey.true), crossings(survey.recorded)
        assert true.all.p95 < 0.02 < 0.15 < recorded.all.p95
        assert abs(true.all.mean) < 0.001

    def test_bent_beams_show_by_angle(self) -> None:
        """Outer soundings of both lines are 0.1 m too high; there, the other line has inner soundings."""
        own = plane("a", 1)
        level = own.points * [1, 1, 0] - [0, 0, 10]
        bent = replace(own, points=level + np.outer(own.points[:, 1] < -6, [0, 0, 0.1]))
        back = bent.places * [1, -1, 1] + np.array([12.0, 10.0, 0.0])
        opposite = replace(bent, name="b", places=back, attitudes=np.tile([0.0, 0.0, np.pi], (100, 1)))
        means = {round(float(np.degrees(a))): seen.mean for a, _, seen in crossings([bent, opposite], 1.0).by_angle}
        assert set(means) == {10, 20, 30, 40}
        assert means[40] == pytest.approx(0.1)
        assert means[10] == pytest.approx(-0.1)
        assert crossings([bent, opposite], 1.0).all.mean == pytest.approx(0, abs=0.01)

    def test_without_overlap_there_are_none(self) -> None:
        seen = crossings([plane("a", 1), plane("b", 2, east=50.0)], cell=1.0)
        assert (seen.cells, seen.all.count, seen.by_lines, seen.by_angle) == (0, 0, (), ())
        assert json.loads(json.dumps(seen.to_json()))["all"] == {
            "count": 0,
            "mean_m": None,
            "std_m": None,
            "p95_m": None,
        }

    @pytest.mark.parametrize("cell", [-1.0, np.nan])
    def test_a_wrong_cell_is_refused(self, cell: float) -> None:
        with pytest.raises(InputError, match="`cell` is"):
            crossings([plane("a", 1)], cell)

    def test_no_lines_are_refused(self) -> None:
        with pytest.raises(InputError, match="no lines"):
            crossings([])

    def test_each_pair_of_three_lines(self) -> None:
        lines = [plane(name, k, higher=up) for k, (name, up) in enumerate([("a", 0.0), ("b", 0.1), ("c", 0.4)])]
        means = {(a, b): own.mean for a, b, own in crossings(lines, cell=1.0).by_lines}
        assert means == pytest.approx({("a", "b"): -0.1, ("a", "c"): -0.4, ("b", "c"): -0.3})
