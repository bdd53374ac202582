"""What key scans show of how a vehicle is off a steady motion: what shakes it, and what turns it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.stream.unsteady import Unsteadiness

SHAKE = np.array([0.03, 0.01, 0.02, 0.02, 0.05, 0.01])
STRIDE = 10  # scans from one key scan to the next


def way(count: int, turn: float, shake: np.ndarray, seed: int = 2) -> RigidTransform:
    """Scans a decimeter apart along a way that swings, with so much turn at most per scan [rad]."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(turn * np.sin(2 * np.pi * np.arange(count) / 150))
    places = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(count)]), axis=0)
    smooth = RigidTransform.from_components(places, Rotation.from_euler("z", heading[:, None]))
    return smooth * RigidTransform.from_exp_coords(shake * rng.standard_normal((count, 6)))


def between(T: RigidTransform, k: int) -> np.ndarray:
    """(6,) what scan k is off a steady motion from the key scan before it to the one behind."""
    i = k // STRIDE * STRIDE
    steady = T[i] * RigidTransform.from_exp_coords((k - i) / STRIDE * (T[i].inv() * T[i + STRIDE]).as_exp_coords())
    return (steady.inv() * T[k]).as_exp_coords()


@pytest.mark.parametrize("shake", [0.0 * SHAKE, 0.1 * SHAKE, SHAKE])
@pytest.mark.parametrize("turn", [0.0, 0.02])
def test_scans_between_are_as_far_off_as_key_scans_tell(turn: float, shake: np.ndarray) -> None:
    """Of three hundred strides; the scans between have never been looked at."""
    T = way(300 * STRIDE + 1, turn, shake)
    keys = np.arange(0, len(T), STRIDE)
    told = Unsteadiness.of(T[keys], keys.astype(float), np.zeros(len(keys), int))
    for offset in (1, 5, 8):
        off = np.array([between(T, k + offset) for k in keys[:-1]])
        squares = (off**2).mean(axis=0)
        # of what is assumed before, a 75th is left
        left = 0.0134 * np.repeat([0.1 * max(turn * STRIDE, 0.05), 0.1], 3) ** 2
        variance = told.variance(offset, STRIDE - offset)
        assert (squares < 1.6 * variance + 1e-9).all()
        assert (variance < 2.5 * squares + 6 * left).all()


def test_what_is_of_two_runs_is_not_compared() -> None:
    """The same way twice, the second time far away and turned around."""
    T, count = way(400, 0.02, SHAKE)[::STRIDE], 40
    elsewhere = RigidTransform.from_components([50.0, -20.0, 5.0], Rotation.from_euler("z", 2.5))
    both = RigidTransform.concatenate([T, elsewhere * T])
    times = np.arange(float(count))
    one = Unsteadiness.of(T, times, np.zeros(count, int))
    two = Unsteadiness.of(both, np.concatenate([times, times]), np.repeat([0, 1], count))
    np.testing.assert_allclose(two.shaken, one.shaken * (72 / 76) / (36 / 40), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_few_key_scans_tell_little(count: int) -> None:
    T = way(STRIDE * count, 0.0, 0 * SHAKE)[::STRIDE]
    told = Unsteadiness.of(T, np.arange(float(count)), np.zeros(count, int))
    np.testing.assert_allclose(told.variance(0.5, 0.5)[3:], (0.1 * 1.0) ** 2, rtol=1e-6)
    np.testing.assert_array_equal(told.shaken, 0)


def test_a_steady_turn_at_uneven_times_is_no_shaking() -> None:
    """The speed of one number changes steadily; half of that is what is found."""
    times = np.array([0.0, 1.0, 3.0, 3.5, 6.0, 7.0, 9.0, 10.0, 12.0])
    T = RigidTransform.from_components(
        np.column_stack([0.5 * times, 0.01 * times**2, 0 * times]), Rotation.identity(len(times))
    )
    told = Unsteadiness.of(T, times, np.zeros(len(times), int))
    np.testing.assert_allclose(told.shaken, 0, atol=1e-20)
    # five key scans know, four are assumed
    assert told.curved[4] - told.curved[5] == pytest.approx(5 / 9 * 0.01**2)
