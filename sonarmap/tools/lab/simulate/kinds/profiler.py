"""Sweeps of a rotating profiler: one narrow beam that steps around a profile while it is panned, or its vehicle turns.

The vehicle drifts during the minutes of a sweep and knows only part of its drift. Points of a panned head are placed as
if the vehicle stood still, and have times. Those of a turning vehicle are placed by its dead reckoning.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.kinds.kind import LARGE_AND_SMALL
from sonarmap.tools.lab.simulate.kinds.partners import Instrument, SweepKind
from sonarmap.tools.lab.simulate.kinds.sweep import Fan, Sweep, Water, walk
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor

WIDTHS = (math.radians(1.7), math.radians(3.0))  # of the beam, least and greatest
STEPS = (math.radians(0.9), math.radians(1.8))  # along a profile
APART = (1.2, 2.4)  # angle between profiles, in steps along a profile
ARCS = ((-180.0, 180.0, 180.0), (-85.0, 40.0, 360.0), (-85.0, 40.0, 270.0))  # elevations from, to; pan [degrees]
ABOVE = (0.08, 0.2)  # height above the ground, in shares of the maximum range
SECONDS = 1.0  # duration of a profile [s]
THRESHOLD = 0.02  # of an echo, relative to that of a near wall

# Standard deviations at either end of a sweep against its middle; lengths in a scene of 256 m [m], times the root of
# the scale: a vehicle on station drifts by decimeters in a pool and by a meter in the sea
DRIFT, HEAVE = 0.8, 0.15
YAW_DRIFT = math.radians(1.0)
TURNING_DRIFT = 0.4  # drift of the dead reckoning of a turning vehicle, likewise [m]
WAY = 0.1  # longest path of such a vehicle during a sweep, in shares of the maximum range
FRAME_TILT = math.radians(1.0)  # standard deviation of roll and pitch of a sweep's frame


@dataclass(frozen=True, slots=True)
class Profiler(Instrument):
    """A profiler on its vehicle; its fan is one profile: the beam at all its steps."""

    pulse = 1 / 500
    pans: np.ndarray  # (K,) angles of the profiles about the vertical, 0 in the middle of the sweep [rad]
    turning: bool  # whether the vehicle turns and moves slowly; otherwise it stands and pans its head

    def target(self, rng: np.random.Generator) -> Sweep:
        """Draw a sweep anywhere in the scene, on any heading."""
        return self._sweep(self.water.place(rng), rng.uniform(-np.pi, np.pi), rng)

    def source(self, target: Sweep, overlaps: tuple[float, float], rng: np.random.Generator) -> Sweep:
        """Draw a sweep on any heading, farther from the target for a smaller overlap."""
        far = 1.2 - rng.uniform(*overlaps)
        here = target.T_world_frame.translation
        reach = min(4 * max(here[2] - self.water.bed, 0.0), 2 * self.water.edge.min())
        return self._sweep(here[:2] + far * reach * rng.uniform(-1, 1, 2), rng.uniform(-np.pi, np.pi), rng)

    def _sweep(self, place: np.ndarray, heading: float, rng: np.random.Generator) -> Sweep:
        """Draw a sweep of profiles above the ground at `place`."""
        count, size = len(self.pans), math.sqrt(self.water.scale)
        height = self.water.height(place, rng.uniform(*ABOVE) * self.water.sensor.max_range, rng)
        believed, drift = np.zeros((count, 3)), DRIFT
        if self.turning:
            drift, course = TURNING_DRIFT, rng.uniform(-np.pi, np.pi)
            length = rng.uniform(0, WAY) * self.water.sensor.max_range
            believed[:, :2] = np.outer(np.arange(count) / count - count // 2 / count, (np.cos(course), np.sin(course)))
            believed *= length
        error = walk(count, (drift * size, drift * size, HEAVE * size, YAW_DRIFT), rng)
        tilt = rng.normal(0.0, FRAME_TILT, 2)
        return Sweep(
            RigidTransform.from_components((*place, height), Rotation.from_euler("ZYX", (heading, *tilt))),
            RigidTransform.from_components(believed + error[:, :3], _about_z(self.pans + error[:, 3])),
            RigidTransform.from_components(believed, _about_z(self.pans)),
            None if self.turning else SECONDS * (np.arange(count) - count // 2),
        )


def _about_z(angles: np.ndarray) -> Rotation:
    return Rotation.from_euler("z", angles[:, None])


def profiler(water: Water, rng: np.random.Generator) -> Profiler:
    """Draw a profiler whose beam steps in the plane of x and z at every pan."""
    width, step = rng.uniform(*WIDTHS), rng.uniform(*STEPS)
    low, high, around = ARCS[rng.integers(len(ARCS))]
    elevation = np.deg2rad(low) + step * np.arange(round(np.deg2rad(high - low) / step))
    apart = step * rng.uniform(*APART)
    pans = apart * np.arange(round(np.deg2rad(around) / apart))
    suits = water.sensor
    sensor = Sensor("profiler", width, width, 3, 3, suits.min_range, suits.max_range, threshold=THRESHOLD)
    beams = np.column_stack([np.cos(elevation), np.zeros(len(elevation)), np.sin(elevation)])
    upward = np.column_stack([-np.sin(elevation), np.zeros(len(elevation)), np.cos(elevation)])
    # three rays on either side of the middle one, on a circle of a third of the width about it
    around_beam = np.array([np.pi / 3 * k for k in range(6)])
    spread = np.column_stack([np.cos(around_beam), np.sin(around_beam)]) * math.tan(width / 3)
    spread = np.insert(spread, 3, 0.0, axis=0)
    rays = beams[:, None] + spread[None, :, :1] * upward[:, None] + spread[None, :, 1:] * np.array((0.0, 1.0, 0.0))
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    # a main lobe 3 dB down at half the width each way
    gains = 10 ** (-0.6 * (np.linalg.norm(spread, axis=1) / math.tan(width / 2)) ** 2)
    return Profiler(water, Fan(sensor, beams, rays, gains), pans - pans[len(pans) // 2], bool(rng.random() < 0.5))


PROFILER = SweepKind("profiler", LARGE_AND_SMALL, profiler)
