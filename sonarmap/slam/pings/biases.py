"""Biases of a sounder's mounting and clock, and their correction in a line."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine

NAMES = ("latency", "roll", "pitch", "heading")


@dataclass(frozen=True, slots=True)
class Biases:
    """Errors of a sounder's mounting and of its positions' clock; all zero if the recording assumed the right ones.

    The angles turn the sounder's axes in the vehicle frame of the motion sensor. They apply in the order heading,
    pitch, roll, as attitudes do.

    Attributes:
        latency: delay of positions [s]: the position with stamp t is that of the time t - latency.
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
        """Biases from (4,) latency [s], roll, pitch and heading [rad]."""
        return cls(*(float(number) for number in array))

    @classmethod
    def of_json(cls, row: Mapping[str, float]) -> "Biases":
        """Inverse of `to_json`."""
        return cls(float(row["latency_s"]), *(float(np.radians(row[f"{name}_deg"])) for name in NAMES[1:]))

    @property
    def array(self) -> np.ndarray:
        """(4,) latency [s], roll, pitch and heading [rad]."""
        return np.array([self.latency, self.roll, self.pitch, self.heading])

    @property
    def R_vehicle_sounder(self) -> Rotation:
        """Rotation of the sounder's axes (x forward, y port, z up) in the vehicle frame."""
        return Rotation.from_euler("ZYX", [-self.heading, -self.pitch, self.roll])

    def __neg__(self) -> "Biases":
        return Biases.of(-self.array)

    def to_json(self) -> dict[str, float]:
        """Latency [s], and the angles in degrees."""
        latency, *angles = self.array.tolist()
        degrees = np.degrees(angles).tolist()
        return {"latency_s": latency} | {f"{name}_deg": d for name, d in zip(NAMES[1:], degrees, strict=True)}


def corrected(line: PingLine, biases: Biases) -> PingLine:
    """The line corrected for these biases.

    The angles turn the soundings about the transducer. The latency moves the places along the track and changes nothing
    else: stamps, attitudes and soundings come from the sounder and the motion sensor, whose clocks are assumed right.
    """
    R_level_vehicle = line.R_level_vehicle
    R = (R_level_vehicle * biases.R_vehicle_sounder * R_level_vehicle.inv()).as_matrix()
    sensors = line.sensors[line.pings]
    points = sensors + np.einsum("nij,nj->ni", R[line.pings], line.points - sensors)
    return replace(line, places=places_at(line, biases.latency), points=points)


def places_at(line: PingLine, later: float) -> np.ndarray:
    """(P, 3) places of the vehicle `later` [s] after each ping, or before [m]; linear, also beyond the ends."""
    stamps, first = np.unique(line.stamps, return_index=True)
    if len(stamps) == 1:
        return line.places
    return make_interp_spline(stamps, line.places[first], k=1)(line.stamps + later)
