"""Lines, and their correction for biases."""

from dataclasses import replace

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.biases import Biases, corrected, places_at
from sonarmap.slam.pings.line import PingLine
from tests.slam.pings.simulated_lines import WRONG, simulated

ONE = {"latency": Biases(latency=0.3), "roll": Biases(roll=0.02), "pitch": Biases(pitch=-0.03)}
ONE |= {"heading": Biases(heading=0.05)}


def single(roll: float = 0.0, pitch: float = 0.0, heading: float = 0.0) -> PingLine:
    """A ping with a sounding 7 m to starboard and 10 m below a transducer 2 m ahead and 1 m below."""
    return PingLine(
        "a",
        np.array([5.0]),
        np.array([[100.0, 200.0, 3.0]]),
        np.array([[roll, pitch, heading]]),
        np.array([[2.0, 0.5, -1.0]]),
        np.array([0]),
        np.array([[2.0, -6.5, -11.0]]),
    )


@pytest.fixture(scope="module")
def line() -> PingLine:
    return simulated(3, pings=60, beams=16).recorded[1]


class TestWorld:
    def test_heading_is_clockwise_from_north(self) -> None:
        a = np.radians(30.0)  # forward (sin a, cos a), starboard (cos a, -sin a)
        east, north = 100 + 2 * np.sin(a) + 6.5 * np.cos(a), 200 + 2 * np.cos(a) - 6.5 * np.sin(a)
        np.testing.assert_allclose(single(heading=a).world_points(), [[east, north, -8.0]], atol=1e-12)
        np.testing.assert_allclose(single(heading=0.0).world_sensors(), [[99.5, 202.0, 2.0]], atol=1e-12)

    def test_roll_lowers_starboard_and_pitch_lifts_the_bow(self) -> None:
        roll, pitch = 0.1, 0.2
        starboard = single(roll).R_level_vehicle.apply([0.0, -1.0, 0.0])
        np.testing.assert_allclose(starboard, [[0, -np.cos(roll), -np.sin(roll)]], atol=1e-12)
        bow = single(0.0, pitch).R_level_vehicle.apply([1.0, 0.0, 0.0])
        np.testing.assert_allclose(bow, [[np.cos(pitch), 0, np.sin(pitch)]], atol=1e-12)

    def test_beams_to_starboard_are_positive(self) -> None:
        assert single().beam_angles() == pytest.approx([np.arctan2(7.0, 10.0)])


class TestRefusal:
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"places": np.zeros((2, 3))}, "wanted a place"),
            ({"points": np.full((1, 3), np.nan)}, "not finite"),
            ({"pings": np.array([1])}, "not there"),
            ({"points": np.zeros((2, 3)), "pings": np.array([0])}, "a ping per sounding"),
        ],
    )
    def test_of_lines(self, change: dict[str, np.ndarray], words: str) -> None:
        with pytest.raises(InputError, match=words):
            replace(single(), **change)

    def test_of_stamps_that_do_not_ascend(self, line: PingLine) -> None:
        with pytest.raises(InputError, match="ascend"):
            replace(line, stamps=line.stamps[::-1])

    @pytest.mark.parametrize("wrong", [{"roll": np.nan}, {"heading": 90.0}])
    def test_of_biases(self, wrong: dict[str, float]) -> None:
        with pytest.raises(InputError, match="angles in radians"):
            Biases(**wrong)


class TestCorrected:
    @pytest.mark.parametrize("name", ONE)
    def test_the_opposite_undoes_each_bias(self, name: str, line: PingLine) -> None:
        back = corrected(corrected(line, ONE[name]), -ONE[name])
        np.testing.assert_allclose(back.points, line.points, atol=1e-11)
        np.testing.assert_allclose(back.places, line.places, atol=0.03)  # places are linear between pings

    def test_latency_moves_places_ahead_and_nothing_else(self) -> None:
        stamps = np.array([0.0, 1.0, 2.0, 4.0])
        places = np.column_stack([3 * stamps, -2 * stamps, 0.1 * stamps])
        line = PingLine("a", stamps, places, np.zeros((4, 3)), np.zeros((4, 3)), np.array([0, 3]), -np.ones((2, 3)))
        moved = corrected(line, Biases(latency=0.5))
        np.testing.assert_allclose(moved.places, places + np.array([1.5, -1.0, 0.05]), atol=1e-12)
        np.testing.assert_allclose(places_at(line, -0.5), places - np.array([1.5, -1.0, 0.05]), atol=1e-12)
        np.testing.assert_allclose(moved.points, line.points, atol=1e-12)
        np.testing.assert_array_equal(moved.stamps, stamps)

    def test_corrected_recordings_are_the_true_lines(self) -> None:
        survey = simulated(4, pings=60, beams=16)
        for recorded, true in zip(survey.recorded, survey.true, strict=True):
            right = corrected(recorded, WRONG)
            np.testing.assert_allclose(right.points, true.points, atol=1e-9)
            np.testing.assert_allclose(right.places, true.places, atol=0.03)
            assert np.abs(recorded.points - true.points).max() > 0.3

    def test_heading_moves_starboard_soundings_astern(self) -> None:
        a = 0.03
        moved = [[2 - 7 * np.sin(a), 0.5 - 7 * np.cos(a), -11]]
        np.testing.assert_allclose(corrected(single(), Biases(heading=a)).points, moved, atol=1e-12)

    def test_pitch_moves_soundings_ahead(self) -> None:
        a = 0.03
        moved = [[2 + 10 * np.sin(a), -6.5, -1 - 10 * np.cos(a)]]
        np.testing.assert_allclose(corrected(single(), Biases(pitch=a)).points, moved, atol=1e-12)

    def test_roll_lowers_starboard_soundings(self) -> None:
        a = 0.03
        y, z = -7 * np.cos(a) + 10 * np.sin(a), -7 * np.sin(a) - 10 * np.cos(a)
        np.testing.assert_allclose(corrected(single(), Biases(roll=a)).points, [[2, 0.5 + y, -1 + z]], atol=1e-12)
