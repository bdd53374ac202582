"""A 3D sonar that is carried on while it measures row after row, and takes itself for standing still.

Its frame is the pose in the middle of the scan. A sonar that steers its rows one after another needs a second or so for
a long range, and half of that for a short one: a row's echoes take 0.16 s from 120 m and 0.02 s from 15 m, and several
rows share a ping.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from sonarmap.tools.lab.simulate.kinds.views.single_view import Shot, single_view_pair
from sonarmap.tools.lab.simulate.sensing.ghosts import reflect_beams
from sonarmap.tools.lab.simulate.sensing.noise import measure
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor, cast_beams

LONG_RANGE = 60.0  # from here on a scan takes the longer time [m]
SCAN_TIME = (0.5, 1.0)  # of a short-range and a long-range sonar [s]
SPEED = 1.0  # at most [m/s]
SIDEWAYS = (1.0, 0.3, 0.2)  # of the speed: forward, to the left, up, before it is drawn how fast
TURN = np.deg2rad(8.0)  # about the vertical at most [rad/s]
ROCK = np.deg2rad(2.0)  # about the level axes at most [rad/s]


@dataclass(frozen=True, slots=True)
class Motion:
    """How the sensor moves during a scan, evenly.

    Attributes:
        velocity: (3,) [m/s], in the frame of the middle of the scan.
        turning: (3,) rotation vector a second [rad/s], likewise.
        seconds: from the first row to the last.
    """

    velocity: np.ndarray
    turning: np.ndarray
    seconds: float

    def poses(self, rows: int) -> RigidTransform:
        """T_middle_row of every row, (rows,) poses, the lowest row's first."""
        time = self.seconds * np.linspace(-0.5, 0.5, rows)[:, None]
        return RigidTransform.from_components(time * self.velocity, Rotation.from_rotvec(time * self.turning))


def draw_motion(sensor: Sensor, rng: np.random.Generator) -> Motion:
    """A vehicle that goes mostly ahead, or backs up, and turns."""
    way = np.array(SIDEWAYS) * rng.uniform(-1, 1, 3)
    velocity = SPEED * rng.uniform(0, 1) * way / np.linalg.norm(way)
    turning = rng.uniform(-1, 1, 3) * (ROCK, ROCK, TURN)
    return Motion(velocity, turning, SCAN_TIME[int(sensor.max_range >= LONG_RANGE)])


def moving_pair(number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
    """A builder of SCAN_KINDS: up to 1 m and 8 degrees from a scan's first row to its last.

    Raises:
        InputError: the scene has no such pair.
    """
    return single_view_pair("moving", number, seed, scene, overlaps, moving_scan)


def moving_scan(shot: Shot) -> Scan:
    """What a sonar that passes through the view's pose in the middle of the scan writes down."""
    return scan_in_motion(shot, draw_motion(shot.observer.sensor, shot.distortion))


def scan_in_motion(shot: Shot, motion: Motion) -> Scan:
    """The scan: every row measured from where the sensor was then, its points placed as if from the middle."""
    world, sensor = shot.observer.world, shot.observer.sensor
    poses = shot.view.T_world_sensor * motion.poses(sensor.rows)
    origins = np.repeat(poses.translation, sensor.columns, axis=0)
    turned = Rotation.from_quat(np.repeat(poses.rotation.as_quat(), sensor.columns, axis=0))
    directions = turned.apply(sensor.directions().reshape(-1, 3))
    echoes = cast_beams(world, sensor, origins, directions)
    ghosts = reflect_beams(world, sensor, origins, directions) if shot.noise.ghosts > 0 else None
    return measure(echoes, sensor, shot.noise, shot.rng, ghosts=ghosts, stamp=shot.stamp, name=shot.name)
