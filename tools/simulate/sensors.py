"""Sensor models, and what one sees of a scene from a pose: ranges and echo strengths, free of noise."""

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from tools.simulate.scenes import Scene

ABSORPTION_DB = 0.06  # of sea water at 240 kHz, one way [dB/m]


@dataclass(frozen=True, slots=True)
class Sensor:
    """A 3D sonar: one range a beam, the beams evenly spaced in azimuth and elevation over the field of view.

    Attributes:
        name: what to call it.
        horizontal, vertical: field of view, the angle between the outer beams [rad].
        columns, rows: beams in azimuth and in elevation.
        min_range, max_range: [m]; what lies nearer or farther gives no echo.
        tilt: angle of the fan's middle below the sensor's x axis [rad]; the frame itself stays level.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    name: str
    horizontal: float
    vertical: float
    columns: int
    rows: int
    min_range: float
    max_range: float
    tilt: float = 0.0

    def __post_init__(self) -> None:
        fan = 0 < self.horizontal < 2 * math.pi and 0 < self.vertical < math.pi
        if not fan or self.columns < 2 or self.rows < 2 or not 0 <= self.min_range < self.max_range:
            raise InputError(
                f"{self} is no sensor; wanted fields of view within 360 and 180 degrees, at least "
                "2 x 2 beams and 0 <= min_range < max_range"
            )

    def directions(self) -> np.ndarray:
        """(rows, columns, 3) float64 unit vectors, sensor frame; the first is the lowest at the right."""
        azimuth = np.linspace(-self.horizontal / 2, self.horizontal / 2, self.columns)[None, :]
        elevation = np.linspace(-self.vertical / 2, self.vertical / 2, self.rows)[:, None]
        level = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation) * np.ones_like(azimuth),
            ],
            axis=-1,
        )
        return level @ Rotation.from_euler("y", self.tilt).as_matrix().T


# The Tritech Eclipse (paper Sect. 4.1), mounted under a vessel and tilted toward the bed
ECLIPSE = Sensor("eclipse", math.radians(120), math.radians(90), 256, 192, 0.4, 120.0, math.radians(20))
# The paper's simulated sensor (Sect. 3): the same fan, its range as long as the 256 m grid
PAPER = Sensor("paper", math.radians(120), math.radians(90), 256, 192, 0.4, 256.0)
SONAR_3D15 = Sensor("sonar3d15", math.radians(90), math.radians(40), 256, 64, 0.2, 15.0)
SENSORS = MappingProxyType({sensor.name: sensor for sensor in (ECLIPSE, PAPER, SONAR_3D15)})


@dataclass(frozen=True, slots=True)
class Echoes:
    """What each beam brings back.

    Attributes:
        ranges: (rows, columns) float64 [m]; inf where the beam meets nothing within the sensor's ranges.
        strengths: (rows, columns) float64, linear, 0..1; 0 where there is no echo.
    """

    ranges: np.ndarray
    strengths: np.ndarray


def cast(scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform) -> Echoes:
    """The nearest surface along every beam, as seen from one pose.

    The echo strength is Lambert's law and the losses of the way: sin^2(grazing angle) * 10^(-2 a r / 10)
    with the absorption a = 0.06 dB/m (240 kHz); the spreading loss is taken as made good by the receiver's
    time-varied gain.
    """
    origin = T_world_sensor.translation
    if origin.shape != (3,):
        raise InputError(f"cast takes one pose at a time; got a stack of shape {origin.shape[:-1]}")
    directions = T_world_sensor.rotation.apply(sensor.directions().reshape(-1, 3))
    ranges, sine_grazing = scene.intersect(np.broadcast_to(origin, directions.shape), directions)
    seen = (ranges >= sensor.min_range) & (ranges <= sensor.max_range)
    way = np.where(seen, ranges, 0.0)
    strengths = np.where(seen, sine_grazing**2 * 10 ** (-2 * ABSORPTION_DB * way / 10), 0.0)
    shape = (sensor.rows, sensor.columns)
    return Echoes(np.where(seen, ranges, np.inf).reshape(shape), strengths.reshape(shape))
