"""Pairs of single views of a 3D sonar whose measurement is distorted: wrong ranges, few echoes, a sensor that moves.

Wrong ranges: a sound speed of 1,500 m/s is wrong by 2 % in water of 1,470 or 1,530 m/s (H. Medwin, Speed of sound in
water: a simple equation for realistic parameters, 1975, doi 10.1121/1.380790). A constant error comes from delays, from
the sensor's reference point, and from the part of a pulse's echo that triggers the detector.

A Water Linked Sonar 3D-15, as six range images of a ship's hull show it (wlsonar, tests/data/ship_short.sonar): 61 to
67 % of the beams have a range, in patches that correlate by 0.66, 0.52, 0.42 and 0.33 over 1, 2, 4 and 8 columns; 45 %
of the neighbors in a row have exactly the same one. So every beam picks the strongest echo of its lobe, speckle and
slow fading included, and reports nothing where even that is weak.

A moving sonar measures its rows one after another within 0.5 or 1 s, as if it stood still.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.kind import LARGE_AND_SMALL, SMALL, Shot, ViewKind
from sonarmap.tools.lab.simulate.sensing.noise import (
    disturb,
    fade,
    measure,
    pick_strongest,
    reflect,
    reflect_beams,
    scan_of,
)
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes, Sensor, cast_beams

SPEED_ERROR = 0.02  # largest relative error of the sound speed, drawn for each scan
MOST_BIAS = 0.01  # largest constant error, in shares of the maximum range, drawn for each scan

# Of the Sonar 3D-15
STEP = 2 * 0.000762939453125  # of a range [m]
LOBE = 1.0  # standard deviation of a beam's main lobe, in beams
LOST = 0.03  # share of beams whose echo is lost at random
WEAKEST = 0.2  # least strength that is reported, linear as Echoes.strengths

# Of the moving sonar
LONG_RANGE = 60.0  # least maximum range of a long-range sonar [m]
SCAN_TIME = (0.5, 1.0)  # duration of a scan of a short-range and a long-range sonar [s]
SPEED = 1.0  # largest speed [m/s]
SIDEWAYS = (1.0, 0.3, 0.2)  # relative bounds of the velocity forward, to the left and up
TURN = np.deg2rad(8.0)  # largest rate of turn about the vertical [rad/s]
ROCK = np.deg2rad(2.0)  # largest rate of turn about the level axes [rad/s]


def distorted_scan(shot: Shot, distort: Callable[[np.ndarray], np.ndarray]) -> Scan:
    """Scan of a still sonar; `distort` changes its ranges [m], those of ghosts included."""
    world, sensor = shot.observer.world, shot.observer.sensor
    ghosts = reflect(world, sensor, shot.view.T_world_sensor) if shot.noise.ghosts > 0 else None
    echoes = replace(shot.view.echoes, ranges=distort(shot.view.echoes.ranges))
    return _write(shot, echoes, ghosts and replace(ghosts, ranges=distort(ghosts.ranges)))


def scaled_scan(shot: Shot) -> Scan:
    """Scan of a view by a sonar with a wrong sound speed."""
    factor = 1 + shot.distortion.uniform(-SPEED_ERROR, SPEED_ERROR)
    return distorted_scan(shot, lambda ranges: factor * ranges)


def shifted_scan(shot: Shot) -> Scan:
    """Scan of a view by a sonar with a constant range error."""
    bias = shot.observer.sensor.max_range * shot.distortion.uniform(-MOST_BIAS, MOST_BIAS)
    return distorted_scan(shot, lambda ranges: ranges + bias)


def real_scan(shot: Shot) -> Scan:
    """Scan of a view by a Sonar 3D-15."""
    sensor, noise = shot.observer.sensor, replace(shot.noise, dropouts=0.0)
    noisy = measure(shot.observer.world, sensor, shot.view.T_world_sensor, shot.view.echoes, noise, shot.rng)
    picked = pick_strongest(fade(noisy, shot.distortion), LOBE)
    weak = (picked.strengths < WEAKEST) | (shot.rng.random(picked.ranges.shape) < LOST)
    steps = np.rint(picked.ranges / STEP) * STEP
    echoes = Echoes(np.where(weak, np.inf, steps), np.where(weak, 0.0, picked.strengths))
    return scan_of(echoes, sensor, stamp=shot.stamp, name=shot.name)


@dataclass(frozen=True, slots=True)
class Motion:
    """Constant velocity of the sensor during a scan."""

    velocity: np.ndarray  # (3,) [m/s], in the frame of the middle of the scan
    turning: np.ndarray  # (3,) rotation vector per second [rad/s], likewise
    seconds: float  # from the first row to the last

    def times(self, rows: int) -> np.ndarray:
        """Times (rows,) [s] of the rows relative to the middle, from the lowest row up."""
        return self.seconds * np.linspace(-0.5, 0.5, rows)

    def poses(self, rows: int) -> RigidTransform:
        """T_middle_row, (rows,) poses of the rows, from the lowest row up."""
        time = self.times(rows)[:, None]
        return RigidTransform.from_components(time * self.velocity, Rotation.from_rotvec(time * self.turning))


def draw_motion(sensor: Sensor, rng: np.random.Generator) -> Motion:
    """Draw the motion of a vehicle that moves mostly ahead or back, and turns."""
    course = np.array(SIDEWAYS) * rng.uniform(-1, 1, 3)
    velocity = SPEED * rng.uniform(0, 1) * course / np.linalg.norm(course)
    turning = rng.uniform(-1, 1, 3) * (ROCK, ROCK, TURN)
    return Motion(velocity, turning, SCAN_TIME[int(sensor.max_range >= LONG_RANGE)])


def scan_in_motion(shot: Shot, motion: Motion) -> Scan:
    """Scan of a moving sonar that passes the view's pose in the middle of the scan: every row is measured from its own
    pose, but its points are placed as if from that in the middle, at the stamp. Times are those of the rows."""
    world, sensor = shot.observer.world, shot.observer.sensor
    poses = shot.view.T_world_sensor * motion.poses(sensor.rows)
    origins = np.repeat(poses.translation, sensor.columns, axis=0)
    turned = Rotation.from_quat(np.repeat(poses.rotation.as_quat(), sensor.columns, axis=0))
    directions = turned.apply(sensor.directions().reshape(-1, 3))
    echoes = cast_beams(world, sensor, origins, directions)
    ghosts = reflect_beams(world, sensor, origins, directions) if shot.noise.ghosts > 0 else None
    return _write(shot, echoes, ghosts, np.tile(motion.times(sensor.rows)[:, None], sensor.columns))


def _write(shot: Shot, echoes: Echoes, ghosts: Echoes | None, times: np.ndarray | None = None) -> Scan:
    sensor = shot.observer.sensor
    noisy = disturb(echoes, sensor, shot.noise, shot.rng, ghosts)
    return scan_of(noisy, sensor, stamp=shot.stamp, name=shot.name, times=times)


SOUND_SPEED = ViewKind("sound_speed", LARGE_AND_SMALL, scaled_scan)
RANGE_BIAS = ViewKind("range_bias", LARGE_AND_SMALL, shifted_scan)
SONAR3D15 = ViewKind("sonar3d15", SMALL, real_scan)
MOVING = ViewKind(
    "moving", LARGE_AND_SMALL, lambda shot: scan_in_motion(shot, draw_motion(shot.observer.sensor, shot.distortion))
)
