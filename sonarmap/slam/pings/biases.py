"""What is wrong with how a sounder is mounted and timed, and a line without it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine

NAMES = ("latency", "roll", "pitch", "heading")
_STEADY = 2.0  # over which the speed is averaged that continues a line beyond its ends [s]


@dataclass(frozen=True, slots=True)
class Biases:
    """Of a sounder with its navigation; all zero where everything is as the recording assumed.

    The angles are those of the sounder's axes in the vehicle's, as the motion sensor shows these, applied in the order
    heading, pitch, roll, as attitudes are.

    Attributes:
        latency: [s] how late positions are: the position with stamp t is that of the time t - latency.
        roll: [rad], positive where the sounder's starboard side is lower than the motion sensor shows.
        pitch: [rad], positive where its bow is higher.
        heading: [rad], positive where it is turned clockwise, seen from above.

    Raises:
        InputError: a number that is not finite, or an angle beyond a right angle.
    """

    latency: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    heading: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.array).all() or (np.abs(self.array[1:]) > np.pi / 2).any():
            raise InputError(f"{self}: wanted finite numbers, and angles in radians of at most a right angle")

    @classmethod
    def of(cls, array: np.ndarray) -> "Biases":
        """Of (4,) latency [s], roll, pitch and heading [rad]."""
        return cls(*(float(number) for number in array))

    @classmethod
    def of_json(cls, row: Mapping[str, float]) -> "Biases":
        """As `to_json` has them."""
        return cls(float(row["latency_s"]), *(float(np.radians(row[f"{name}_deg"])) for name in NAMES[1:]))

    @property
    def array(self) -> np.ndarray:
        """(4,) latency [s], roll, pitch and heading [rad]."""
        return np.array([self.latency, self.roll, self.pitch, self.heading])

    @property
    def R_vehicle_sounder(self) -> Rotation:
        """How the sounder's axes (x forward, y port, z up) are turned in the vehicle's."""
        return Rotation.from_euler("ZYX", [-self.heading, -self.pitch, self.roll])

    def __neg__(self) -> "Biases":
        return Biases.of(-self.array)

    def to_json(self) -> dict[str, float]:
        """Latency [s], and the angles in degrees."""
        latency, *angles = self.array.tolist()
        degrees = np.degrees(angles).tolist()
        return {"latency_s": latency} | {f"{name}_deg": d for name, d in zip(NAMES[1:], degrees, strict=True)}


def corrected(line: PingLine, biases: Biases) -> PingLine:
    """The line without these biases.

    Soundings turn about the transducer. The latency moves places along the line's own motion, and changes nothing
    else: stamps, attitudes and soundings are those of the sounder and the motion sensor, whose times are believed.
    """
    R_level_vehicle = line.R_level_vehicle
    R = (R_level_vehicle * biases.R_vehicle_sounder * R_level_vehicle.inv()).as_matrix()
    sensors = line.sensors[line.pings]
    points = sensors + np.einsum("nij,nj->ni", R[line.pings], line.points - sensors)
    return replace(line, places=places_at(line, biases.latency), points=points)


def places_at(line: PingLine, later: float) -> np.ndarray:
    """(P, 3) where the line says that the vehicle was this much later than the pings [m]; `later` [s] may be negative.

    Linear between pings; before the first and after the last at the mean velocity of the two seconds beside.
    """
    stamps, places = line.stamps, line.places
    asked = stamps + later
    between = np.column_stack([np.interp(asked, stamps, axis) for axis in places.T])
    span = min(_STEADY, stamps[-1] - stamps[0])
    if span <= 0:
        return between
    for end, beside in ((0, stamps[0] + span), (-1, stamps[-1] - span)):
        near = np.array([np.interp(beside, stamps, axis) for axis in places.T])
        velocity = (places[end] - near) / (stamps[end] - beside)
        beyond = np.minimum(asked - stamps[0], 0) if end == 0 else np.maximum(asked - stamps[-1], 0)
        between += beyond[:, None] * velocity
    return between


def velocities(line: PingLine) -> np.ndarray:
    """(P, 3) over a second about each ping [m/s], as its places have them."""
    return places_at(line, 0.5) - places_at(line, -0.5)
