"""Swaths of a multibeam echo sounder: a fan across the track of a vessel that moves while it measures.

The fan is that of usual shallow-water sounders (R2Sonic 2022, data sheet). The sounder's motion is compensated up to
the errors of a surveyor's budget (R. Hare, Depth and position error budgets for multibeam echosounding, International
Hydrographic Review 72(2), 1995) and of dead reckoning (K. Tang et al., Sensors 13, 2013, doi 10.3390/s131114583).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.kinds.kind import FROM_ABOVE
from sonarmap.tools.lab.simulate.kinds.partners import Instrument, SweepKind
from sonarmap.tools.lab.simulate.kinds.sweep import Fan, Sweep, Water, walk, wobble
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor

BEAMS = 256
ACROSS = (math.radians(120), math.radians(150))  # least and greatest angle of the fan
ALONG = math.radians(1.0)
LENGTHS = (0.25, 0.6)  # of a line, in shares of the scene's longer side
DEPTHS = (1.0, 3.0)  # of the sounder below the highest place in a scene of 256 m [m]
PINGS = (24, 400)  # least and most
BEND = math.radians(15)  # largest turn of a line from one end to the other
WAVES = 12  # number of waves of the vessel's motion along a line
SWING = (math.radians(3.0), math.radians(1.5), math.radians(1.0))  # standard deviations of roll, pitch, yaw
HEAVE = 0.3  # standard deviation in a scene of 256 m [m]

ROLL_ERROR, YAW_ERROR = math.radians(0.1), math.radians(0.3)  # standard deviations; pitch errs as roll does
HEAVE_ERROR = 0.05  # standard deviation in a scene of 256 m [m]
DRIFT = 0.3  # standard deviation of East and of North at either end of a line against its middle, likewise [m]
GATE = 4.0  # maximum range of the sounder, in heights above the bed
THRESHOLD = 0.02  # of an echo, relative to that of a near wall: far ground at grazing angles is lost
FRAME_TILT = math.radians(0.3)  # standard deviation of roll and pitch of a swath's frame


@dataclass(frozen=True, slots=True)
class Sounder(Instrument):
    """A sounder on its vessel, which picks the strongest ray of each footprint."""

    across: float  # the fan's angle [rad]

    def target(self, rng: np.random.Generator) -> Sweep:
        """Draw a line anywhere in the scene, on any heading."""
        return self._line(rng.uniform(-self.water.edge, self.water.edge), rng.uniform(-np.pi, np.pi), rng)

    def source(self, target: Sweep, overlaps: tuple[float, float], rng: np.random.Generator) -> Sweep:
        """Draw a line beside the target's, in the same or the opposite direction, or across it."""
        here, heading = target.T_world_frame.translation, target.T_world_frame.rotation.as_euler("ZYX")[0]
        turn = rng.choice([0.0, np.pi, np.pi / 2, -np.pi / 2]) + rng.normal(0.0, 0.3)
        length = np.linalg.norm(np.diff(target.T_frame_ping[[0, -1]].translation, axis=0))
        far = 1 - rng.uniform(*overlaps)
        aside = Rotation.from_euler("z", heading).apply(
            np.array((length, self._width(here), 0.0)) * rng.uniform(-1, 1, 3) * far
        )
        return self._line((here + aside)[:2], heading + turn, rng)

    def _width(self, place: np.ndarray) -> float:
        """Width [m] of a swath over a flat bed as deep as below `place`, limited by the maximum range."""
        height = float(place[2] - self.water.ground(place[None, :2])[0])
        reach = self.fan.sensor.max_range * math.sin(self.across / 2)
        return 2 * min(abs(height) * math.tan(self.across / 2), reach)

    def _line(self, middle: np.ndarray, heading: float, rng: np.random.Generator) -> Sweep:
        """Draw a line whose pings are as far apart as the soundings across the track on average."""
        scale = self.water.scale
        length = rng.uniform(*LENGTHS) * 2 * self.water.edge.max()
        top = self.water.top - rng.uniform(*DEPTHS) * scale
        spacing = self._width(np.array([*middle, top])) / BEAMS
        count = int(np.clip(length / spacing, *PINGS))
        along, bend = np.linspace(-0.5, 0.5, count), rng.uniform(-BEND, BEND)
        # an arc whose heading turns evenly by `bend`
        path = np.column_stack([along * length, along**2 * length * bend / 2, np.zeros(count)])
        width = count / WAVES / 4
        swing = wobble(count, SWING, width, rng) + np.outer(along, (0.0, 0.0, bend))
        path[:, 2] += wobble(count, (HEAVE * scale,), width, rng)[:, 0]
        T_line_ping = RigidTransform.from_components(path, Rotation.from_euler("ZYX", swing[:, ::-1]))
        level = RigidTransform.from_components((*middle, top), Rotation.from_euler("z", heading))
        tilt = Rotation.from_euler("ZYX", (0.0, *rng.normal(0.0, FRAME_TILT, 2)))
        T_line_frame = RigidTransform.from_components(path[count // 2], tilt)
        T_frame_ping = T_line_frame.inv() * T_line_ping
        return Sweep(level * T_line_frame, T_frame_ping, _believed(T_frame_ping, scale, width, rng))


def _believed(T_frame_ping: RigidTransform, scale: float, width: float, rng: np.random.Generator) -> RigidTransform:
    """The compensated motion: the true one with errors of the motion sensor and of navigation."""
    count = len(T_frame_ping)
    turns = wobble(count, (ROLL_ERROR, ROLL_ERROR, YAW_ERROR), width, rng)
    drift = walk(count, (DRIFT * scale, DRIFT * scale), rng)
    heave = wobble(count, (HEAVE_ERROR * scale,), width, rng)
    shifts = T_frame_ping.translation + np.column_stack([drift, heave])
    return RigidTransform.from_components(shifts, T_frame_ping.rotation * Rotation.from_rotvec(turns))


def sounder(water: Water, rng: np.random.Generator) -> Sounder:
    """Draw a sounder with a fan angle from ACROSS: x along the track, the fan's middle straight down."""
    across = rng.uniform(*ACROSS)
    gate = min(GATE * (water.top - water.bed), water.sensor.max_range)
    sensor = Sensor("swath", across, ALONG, BEAMS, 3, water.sensor.min_range, gate, threshold=THRESHOLD)
    angle = np.linspace(-across / 2, across / 2, BEAMS)
    beams = np.column_stack([np.zeros(BEAMS), np.sin(angle), -np.cos(angle)])
    fore = np.array((-1 / 3, 0.0, 1 / 3)) * ALONG
    rays = np.cos(fore)[:, None] * beams[:, None, :] + np.sin(fore)[:, None] * np.array((1.0, 0.0, 0.0))
    # a main lobe 3 dB down at half the footprint each way
    return Sounder(water, Fan(sensor, beams, rays, 10 ** (-0.6 * (fore / (ALONG / 2)) ** 2)), across)


SWATH = SweepKind("swath", FROM_ABOVE, sounder)
