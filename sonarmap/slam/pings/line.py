"""A line of a multibeam echo sounder: pings along the vehicle's track, each with a row of soundings."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError


@dataclass(frozen=True, slots=True)
class PingLine:
    """Pings with the line's own navigation, and the soundings that were not rejected.

    The frame of a ping is level: x horizontal along the heading, y to port, z up. Its origin is the vehicle's point
    that `places` give, at the level from which the recording counts depths.

    Attributes:
        name: shown in messages and tables.
        stamps: (P,) float64 [s, UTC], ascending, P >= 1.
        places: (P, 3) float64 East, North, Up [m] in the world.
        attitudes: (P, 3) float64 [rad]: roll, starboard side down; pitch, bow up; heading, clockwise from the world's
            North.
        sensors: (P, 3) float64 [m], positions of the transducer in the pings' frames.
        pings: (N,) int64, ascending: the ping of each sounding.
        points: (N, 3) float64 [m], soundings in the frames of their pings.

    Raises:
        InputError: shapes do not match, stamps or pings do not ascend, or a number is not finite.
    """

    name: str
    stamps: np.ndarray
    places: np.ndarray
    attitudes: np.ndarray
    sensors: np.ndarray
    pings: np.ndarray
    points: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.stamps)
        per_ping = (self.places, self.attitudes, self.sensors)
        fits = all(array.shape == (count, 3) for array in per_ping) and self.points.shape == (len(self.pings), 3)
        if not fits or count == 0:
            raise InputError(f"{self.name}: wanted a place, an attitude and a sensor per ping, and a ping per sounding")
        if not all(np.isfinite(array).all() for array in (self.stamps, *per_ping, self.points)):
            raise InputError(f"{self.name}: some numbers are not finite; leave out those pings or soundings")
        if (np.diff(self.stamps) < 0).any() or (np.diff(self.pings) < 0).any():
            raise InputError(f"{self.name}: stamps or pings do not ascend")
        if len(self.pings) and not 0 <= self.pings[0] <= self.pings[-1] < count:
            raise InputError(f"{self.name}: soundings of pings that are not there")

    @property
    def T_world_level(self) -> RigidTransform:
        """Poses of the P pings' frames in the world."""
        yaw = np.pi / 2 - self.attitudes[:, 2]
        return RigidTransform.from_components(self.places, Rotation.from_euler("Z", yaw[:, None]))

    @property
    def R_level_vehicle(self) -> Rotation:
        """P rotations of the vehicle (x forward, y port, z up) in the pings' frames."""
        return R_level_vehicle_of(self.attitudes)

    @property
    def length(self) -> float:
        """Horizontal length of the track [m]."""
        return float(np.linalg.norm(np.diff(self.places[:, :2], axis=0), axis=1).sum())

    def world_points(self) -> np.ndarray:
        """(N, 3) soundings in the world [m]."""
        return self.T_world_level[self.pings].apply(self.points)

    def world_sensors(self) -> np.ndarray:
        """(P, 3) positions of the transducer in the world [m]."""
        return self.T_world_level.apply(self.sensors)

    def beam_angles(self) -> np.ndarray:
        """(N,) beam angles from straight down, positive to starboard [rad]."""
        ray = self.points - self.sensors[self.pings]
        return np.arctan2(-ray[:, 1], np.maximum(-ray[:, 2], 1e-9))

    def cut(self, first: int, last: int) -> "PingLine":
        """The line with only the pings first to last - 1."""
        a, b = np.searchsorted(self.pings, [first, last])
        per_ping = {name: getattr(self, name)[first:last] for name in ("stamps", "places", "attitudes", "sensors")}
        return replace(self, **per_ping, pings=self.pings[a:b] - first, points=self.points[a:b])


def R_level_vehicle_of(attitudes: np.ndarray) -> Rotation:
    """P rotations of a vehicle (x forward, y port, z up) in its level frames, by (P, 3) roll, pitch, heading [rad]."""
    return Rotation.from_euler("YX", attitudes[:, 1::-1] * [-1, 1])
