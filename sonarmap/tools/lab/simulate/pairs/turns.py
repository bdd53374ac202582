"""How the frame of a pair's source is turned against its sensor: a sonar mounted otherwise, any rotation at all."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError

Turn = Literal["view", "yaw", "any"]


@dataclass(frozen=True, slots=True)
class FrameTurn:
    """What is drawn of a pair's relative rotation before its poses are.

    Attributes:
        turn: "view": the frame is the sensor's own. "yaw": it is turned about z by any angle, and tilted, so that
            roll and pitch of R_target_frame are those below. "any": R_target_frame is `R`.
        about_z: by how much the frame is turned about its z, -pi..pi [rad].
        pitch, roll: of R_target_frame = Rz(yaw) Ry(pitch) Rx(roll) [rad].
        R: uniform on SO(3).
    """

    turn: Turn
    about_z: float
    pitch: float
    roll: float
    R: Rotation

    def R_target_sensor(self, aside: float, share: float) -> Rotation:
        """The attitude of a source whose view differs by `aside` [rad] about z, and by a `share` of the tilt, 0..1.

        With all of it the source's frame is its sensor's, turned about z.
        """
        tilted = Rotation.from_euler("ZYX", (aside + self.about_z, share * self.pitch, share * self.roll))
        return tilted * Rotation.from_euler("z", -self.about_z)

    def R_target_frame(self, R_target_sensor: Rotation) -> Rotation:
        """The attitude of the source's frame, whatever that of its sensor."""
        if self.turn == "view":
            return R_target_sensor
        if self.turn == "any":
            return self.R
        yaw = (R_target_sensor * Rotation.from_euler("z", self.about_z)).as_euler("ZYX")[0]
        return Rotation.from_euler("ZYX", (yaw, self.pitch, self.roll))


def draw_turn(turn: Turn, max_tilt: float, rng: np.random.Generator) -> FrameTurn:
    """A frame's turn, its roll and pitch uniform up to `max_tilt` [rad].

    Raises:
        InputError: an unknown turn.
    """
    if turn not in get_args(Turn):
        raise InputError(f"a pair's turn is {turn!r}; wanted one of {', '.join(get_args(Turn))}")
    about_z = rng.uniform(-np.pi, np.pi)
    pitch, roll = rng.uniform(-max_tilt, max_tilt, 2)
    # a normal vector of four numbers points anywhere evenly, and so does its unit quaternion
    return FrameTurn(turn, about_z, pitch, roll, Rotation.from_quat(rng.standard_normal(4)))
