"""Sensor models, and their noise-free echoes of a scene from a pose: ranges and strengths."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import COORDINATE_LIMIT
from sonarmap.tools.lab.simulate.scenes.scene import Scene

_FARTHEST = COORDINATE_LIMIT  # [m]: points farther off cannot be read from a file
ABSORPTION_DB = 0.06  # of sea water at 240 kHz, one way [dB/m]


@dataclass(frozen=True, slots=True)
class Sensor:
    """A 3D sonar: one range per beam, the beams evenly spaced in azimuth and elevation over the field of view."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    name: str
    horizontal: float  # field of view, the angle between the outer beams [rad]
    vertical: float  # field of view, likewise [rad]
    columns: int  # beams in azimuth
    rows: int  # beams in elevation
    min_range: float  # nearer surfaces give no echo [m]
    max_range: float  # farther surfaces give no echo [m]
    tilt: float = 0.0  # angle of the fan's middle below the sensor's x axis [rad]; the frame itself stays level
    # two-way loss of an echo at half the horizontal field of view from the fan's middle [dB]; it grows with the square
    # of the angle, as in a Gaussian main lobe. 0: no loss
    edge_loss: float = 0.0
    absorption: float = ABSORPTION_DB  # of the water at the sensor's frequency, one way [dB/m]
    threshold: float = 0.0  # echoes weaker than this are discarded, linear as Echoes.strengths; 0 keeps all
    resolution: float = 0.0  # step of the ranges [m]; 0: exact ranges

    def __post_init__(self) -> None:
        fan = 0 < self.horizontal < 2 * math.pi and 0 < self.vertical < math.pi
        if not fan or self.columns < 2 or self.rows < 2 or not 0 <= self.min_range < self.max_range <= _FARTHEST:
            raise InputError(
                f"{self} is not a sensor; wanted fields of view within 360 and 180 degrees, at least "
                f"2 x 2 beams and 0 <= min_range < max_range <= {_FARTHEST:g} m"
            )
        for name in ("edge_loss", "absorption", "threshold", "resolution"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"the sensor {self.name}: {name} is {value}; wanted a finite number >= 0")

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

    def pattern(self) -> np.ndarray:
        """(rows, columns) float64: two-way strength of each beam relative to the middle of the fan, 0..1."""
        middle = np.array((math.cos(self.tilt), 0.0, -math.sin(self.tilt)))
        off_middle = np.arccos(np.clip(self.directions() @ middle, -1.0, 1.0))
        return 10 ** (-self.edge_loss / 10 * (off_middle / (self.horizontal / 2)) ** 2)


def bare(sensor: Sensor) -> Sensor:
    """The sensor's fan alone: equally sensitive in all directions, without a threshold, and with exact ranges."""
    return replace(sensor, edge_loss=0.0, threshold=0.0, resolution=0.0)


# The Tritech Eclipse (paper Sect. 4.1: 240 kHz, 256 beams over 120 degrees, an effective angular resolution of 0.5
# degrees, here the beams' spacing, ranges in steps of 2.5 cm, weak echoes discarded), mounted under a vessel and
# tilted toward the bed. The paper gives neither beam pattern nor threshold: 12 dB each way at the edge, and a
# threshold of 1/500 of a near wall's echo, leave about 90 of the 120 degrees, as it reports
_FAN = math.radians(120), math.radians(90), 256, 192
ECLIPSE = Sensor("eclipse", *_FAN, 0.4, 120.0, tilt=math.radians(20), edge_loss=24.0, threshold=0.002, resolution=0.025)
# The paper's simulated sensor (Sect. 3): the same fan, its range as long as the 256 m grid
PAPER = Sensor("paper", *_FAN, 0.4, 256.0)
# The Water Linked Sonar 3D-15: its fan and reach. Its maker gives no beam pattern, so the edge has no loss
SONAR_3D15 = Sensor("sonar3d15", math.radians(90), math.radians(40), 256, 64, 0.2, 15.0)
SENSORS = {sensor.name: sensor for sensor in (ECLIPSE, PAPER, SONAR_3D15)}


@dataclass(frozen=True, slots=True)
class Echoes:
    """One echo per beam."""

    ranges: np.ndarray  # (rows, columns) float64 [m]; inf without a surface within the sensor's ranges
    strengths: np.ndarray  # (rows, columns) float64, linear, 0..1; 0 where there is no echo


def cast(scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform) -> Echoes:
    """Echoes of the nearest surface along every beam from one pose, including those below the threshold."""
    return cast_beams(scene, sensor, *beams(sensor, T_world_sensor))


def cast_beams(scene: Scene, sensor: Sensor, origins: np.ndarray, directions: np.ndarray) -> Echoes:
    """As `cast`, with one origin per beam: origins [m] and unit vectors, both (rows * columns, 3), world."""
    return echoes_of(sensor, *scene.intersect(origins, directions))


def beams(sensor: Sensor, T_world_sensor: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
    """Origins [m] and unit vectors of the beams from one pose, both (rows * columns, 3), world frame."""
    directions = T_world_sensor.rotation.apply(sensor.directions().reshape(-1, 3))
    return np.broadcast_to(T_world_sensor.translation, directions.shape), directions


def echoes_of(sensor: Sensor, ranges: np.ndarray, sine_grazing: np.ndarray) -> Echoes:
    """Echoes from the beams' ranges [m], inf without a surface, and sines of grazing angles, both (rows * columns,).

    The strength is Lambert's law, absorption and the beam pattern: sin^2(grazing angle) * 10^(-2 a r / 10) * pattern,
    with the sensor's absorption a. The receiver's time-varied gain is taken to compensate the spreading loss.
    """
    seen = (ranges >= sensor.min_range) & (ranges <= sensor.max_range)
    distance = np.where(seen, ranges, 0.0)
    lost = 10 ** (-2 * sensor.absorption * distance / 10)
    strengths = np.where(seen, sine_grazing**2 * lost, 0.0).reshape(sensor.rows, sensor.columns)
    return Echoes(np.where(seen, ranges, np.inf).reshape(strengths.shape), strengths * sensor.pattern())
