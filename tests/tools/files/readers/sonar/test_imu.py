"""The IMU in a recording: attitude from gravity, turn rates, and when there is none to be had."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wlsonar import range_image_protocol as rip

from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import values_of
from sonarmap.tools.files.readers.sonar.recording import turn_rates
from tests.samples.recordings import START, imu_batch, imu_packets, range_image, read_sonar

pytestmark = pytest.mark.filterwarnings("error")
GRAVITY = 9.82
ROLL, PITCH = 12.0, -5.0  # degrees, as on displays: starboard down, nose up
LEVEL = np.array([0.0, 0.0, -GRAVITY])  # z is down in the file, and the force that holds the sonar up points up


def at_rest(roll: float, pitch: float) -> np.ndarray:
    """(3,) the force in the file's axes, x forward, y right, z down, of a sonar with this attitude [deg]."""
    R_down_sensor = Rotation.from_euler("ZYX", [30.0, pitch, roll], degrees=True)  # aerospace order, NED from FRD
    return R_down_sensor.inv().apply(LEVEL)


def shot(seconds: float, number: int = 0) -> bytes:
    """A range image so long after START's whole second."""
    image = range_image(number, np.full((3, 4), 80))
    image.header.timestamp.seconds = int(START) + int(seconds)
    image.header.timestamp.nanos = round(seconds % 1 * 1e9)
    return rip.packb(image)


def unknown(*packets: bytes) -> bool:
    """Whether the only shot has no attitude."""
    (cloud,) = read_sonar(b"".join(packets))
    return cloud.prior is None


def prior_of(*packets: bytes) -> PosePrior:
    """Of the only shot."""
    (cloud,) = read_sonar(b"".join(packets))
    assert cloud.prior is not None
    return cloud.prior


def angles_of(prior: PosePrior) -> np.ndarray:
    """Roll and pitch [deg]."""
    return values_of(prior.T_world_sensor)[:2]


class TestAttitude:
    @pytest.mark.parametrize(("roll", "pitch"), [(ROLL, PITCH), (170, 10), (5, 80)])
    def test_roll_and_pitch_of_a_sonar_at_rest(self, roll: float, pitch: float) -> None:
        packets = imu_packets(2.0, lambda _: at_rest(roll, pitch), np.zeros(3))
        prior = prior_of(*packets[:10], shot(1.0), *packets[10:])
        np.testing.assert_allclose(angles_of(prior), [roll, pitch], atol=1e-4)
        force = at_rest(roll, pitch) * [1, -1, -1]  # which the prior turns to the world's vertical
        np.testing.assert_allclose(prior.T_world_sensor.apply(force), [0, 0, GRAVITY], atol=1e-4)
        assert prior.knows_attitude
        np.testing.assert_array_equal(prior.sigmas[2:], np.inf)
        assert 1.5 <= np.rad2deg(prior.sigmas[0]) < 1.6
        assert prior.sigmas[0] == prior.sigmas[1]

    def test_the_attitude_of_a_turning_sonar_is_that_at_the_shot(self) -> None:
        """A roll at 40 degrees per second, also where all samples are before the shot."""
        for seconds, batches in ((0.7, 20), (0.7, 7)):
            packets = imu_packets(batches / 10, lambda t: at_rest(40.0 * t, 3.0), np.deg2rad([40.0, 0.0, 0.0]))
            np.testing.assert_allclose(angles_of(prior_of(*packets, shot(seconds))), [28.0, 3.0], atol=0.3)

    def test_accelerations_of_waves_increase_the_sigmas(self) -> None:
        """Of 0.3 m/s^2 and 3 s: what it says is off by up to 1.5 degrees, and it says so."""
        sigmas, pulls = [], []
        for phase in np.linspace(0, 2 * np.pi, 12):
            waves = partial(lambda phase, t: LEVEL + np.array([0.3 * np.sin(2 * np.pi * t / 3 + phase), 0, 0]), phase)
            prior = prior_of(*imu_packets(1.0, waves, np.zeros(3)), shot(0.5))
            sigmas.append(np.rad2deg(prior.sigmas[0]))
            pulls.append(values_of(prior.T_world_sensor)[1] / sigmas[-1])
        assert max(sigmas) > 1.6
        assert np.sqrt(np.mean(np.square(pulls))) < 1.0

    @pytest.mark.parametrize(
        "force",
        [lambda t: 1.1 * LEVEL, lambda t: LEVEL + np.array([3 * np.sin(6 * t), 0, 0]), lambda t: np.zeros(3)],
        ids=["heaves", "surges", "falls"],
    )
    def test_an_accelerating_vehicle_has_no_attitude(self, force) -> None:
        assert unknown(*imu_packets(1.0, force, np.zeros(3)), shot(0.5))

    def test_without_samples_near_the_shot_there_is_no_attitude(self) -> None:
        packets = imu_packets(1.0, lambda _: LEVEL, np.zeros(3))
        for seconds in (1.2, 5.0):
            assert unknown(*packets, shot(seconds))
        assert unknown(shot(0.5))

    def test_contradictory_batches_are_left_out_as_damaged(self) -> None:
        wrong = [imu_batch(k, [0.1, 0.2], np.ones((2, 3)), np.ones((2, 3))) for k in range(3)]
        wrong[0].samples = 3
        wrong[1].specific_force.append(1.0)
        wrong[2].rate_of_turn[2] = np.nan
        notes: list[str] = []
        read_sonar(b"".join([shot(0.5), *map(rip.packb, wrong)]), notes)
        (note,) = notes
        assert "3 damaged packets left out" in note
        assert "packet 2 at byte" in note
        assert "is an IMU batch of 3 samples with 2 times, 6 forces and 6 turn rates" in note

    def test_lost_and_doubled_batches_are_counted(self) -> None:
        packets = imu_packets(2.0, lambda _: LEVEL, np.zeros(3))
        notes: list[str] = []
        read_sonar(b"".join([*packets[:4], packets[3], *packets[7:], shot(1.0)]), notes)
        assert [note.partition(": ")[2] for note in notes] == [
            "3 batches of the IMU missing by their numbers",
            "1 doubled batch of the IMU left out",
        ]


class TestTurnRates:
    def test_turn_rates_are_turned_to_our_axes(self, tmp_path: Path) -> None:
        packets = imu_packets(1.0, lambda _: LEVEL, np.array([0.1, 0.2, -0.3]))
        path = tmp_path / "dive.sonar"
        path.write_bytes(b"".join([*packets[5:], shot(0.5), *packets[:6], b"garbage"]))
        times, rates = turn_rates(path)
        np.testing.assert_allclose(times, int(START) + np.arange(100) / 100, atol=1e-6)
        np.testing.assert_allclose(rates, np.tile([0.1, -0.2, 0.3], (100, 1)), atol=1e-7)
