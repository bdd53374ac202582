"""The sonar on its vehicle: cases worked by hand, with numbers that tell every axis and sign."""

import numpy as np
import pytest

from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import prior_of, sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.settings import NavFrame, parse_mount
from tests.samples.refusals import refuses

SIGMAS = np.array([1.0, 2.0, 3.0, 0.5, 0.5, 0.1])


def vehicle(*values: float, sigmas: np.ndarray = SIGMAS) -> PosePrior:
    return prior_of(np.array(values), sigmas)


def seen(mount: str, *values: float, frame: NavFrame | None = None) -> np.ndarray:
    """Roll, pitch, heading, x, y, depth of the sonar."""
    return values_of(parse_mount(mount, frame).of_sensor(vehicle(*values)).T_world_sensor)


class TestByHand:
    @pytest.mark.parametrize(
        ("mount", "pose", "wanted"),
        [
            # heading East: forward is East, starboard South
            ("0,0,0,2,0.5,0.25", (0, 0, 90, 10, 20, 7), (0, 0, 90, 12, 19.5, 7.25)),
            # heading North, nose up 30: 2 m forward are 2 cos 30 North and 1 m up
            ("0,0,0,2,0,0", (0, 30, 0, 0, 0, 7), (0, 30, 0, 0, 3**0.5, 6)),
            # looking to starboard: its right side is the vehicle's stern
            ("0,0,90", (0, 10, 200, 0, 0, 0), (10, 0, 290, 0, 0, 0)),
            # upside down: its starboard side is the vehicle's port side
            ("180,0,0,1,2,3", (0, 0, 0, 0, 0, 0), (180, 0, 0, 2, 1, 3)),
        ],
    )
    def test_arms_match_cases_by_hand(self, mount: str, pose: tuple[float, ...], wanted: tuple[float, ...]) -> None:
        values = seen(mount, *pose)
        np.testing.assert_allclose([abs(values[0]), *values[1:]], [abs(wanted[0]), *wanted[1:]], atol=1e-9)

    def test_all_axes_at_once_match_the_textbooks_matrices(self) -> None:
        """T_world_sensor = T_world_vehicle * T_vehicle_sensor with forward-right-down matrices, written out."""
        mount, pose = (11.0, -23.0, 37.0), (-5.0, 14.0, 250.0)

        def R_ned(roll: float, pitch: float, heading: float) -> np.ndarray:
            (cr, cp, ch), (sr, sp, sh) = (f(np.radians([roll, pitch, heading])) for f in (np.cos, np.sin))
            yaw = np.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])
            nose = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            return yaw @ nose @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])

        R = R_ned(*pose) @ R_ned(*mount)
        values = seen("11,-23,37,0.5,-0.25,1.5", *pose, 100, 200, 30)
        wanted = [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0]) % (2 * np.pi)]
        np.testing.assert_allclose(values[:3], np.degrees(wanted), atol=1e-9)
        north, east, down = np.array([200, 100, 30]) + R_ned(*pose) @ [0.5, -0.25, 1.5]
        np.testing.assert_allclose(values[3:], [east, north, down], atol=1e-9)

    def test_a_mount_in_a_frame_that_points_up_gives_the_same_pose(self) -> None:
        """Forward, left, up: pitch nose down, heading to port, Y port, Z up."""
        up = seen("11,23,-37,0.5,0.25,-1.5", -5, 14, 250, 1, 2, 3, frame="flu")
        down = seen("11,-23,37,0.5,-0.25,1.5", -5, 14, 250, 1, 2, 3)
        np.testing.assert_allclose(up, down, atol=1e-9)


class TestUncertainty:
    def test_sigmas_of_the_rotation_add_to_those_at_the_end_of_the_arm(self) -> None:
        prior = parse_mount("0,0,0,3,0,4").of_sensor(vehicle(0, 0, 0, 0, 0, 0))
        tilt, turn = np.radians(2), np.radians(3)
        np.testing.assert_allclose(prior.sigmas[3:5], np.sqrt(0.5**2 + (4 * tilt) ** 2 + (3 * turn) ** 2))
        np.testing.assert_allclose(prior.sigmas[5], np.hypot(0.1, 3 * tilt))
        np.testing.assert_allclose(sigmas_of(prior)[:2], 2)  # the larger of both

    def test_without_a_heading_the_length_of_the_arm_adds_to_the_sigmas(self) -> None:
        bare = vehicle(1, 2, np.nan, 10, 20, 7)
        prior = parse_mount("0,0,0,3,0,4").of_sensor(bare)
        np.testing.assert_allclose(prior.T_world_sensor.translation[:2], [10, 20])
        assert prior.T_world_sensor.translation[2] == pytest.approx(-7 - 4, abs=0.2)
        assert (prior.sigmas[3:5] >= 5).all()
        assert not prior.knows_heading

    def test_a_steep_mount_needs_roll_and_pitch(self) -> None:
        alone = vehicle(np.nan, np.nan, 30, 1, 2, 3)
        refuses(r"mounted at a tilt of 40 degrees.*columns of roll and pitch", parse_mount("0,-40,0").of_sensor, alone)
        assert parse_mount("0,-20,0").of_sensor(alone).knows_heading


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan", "400,0,0", "0,0,0,0,0,200"])
def test_invalid_mounts_are_refused(text: str) -> None:
    refuses(r"--mount is .* as in --mount 0,-30,0,0\.4,0,0\.2", parse_mount, text)
