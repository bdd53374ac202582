"""What is done to points once, when they are read: turned to our axes, into meters, their ranges corrected."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.pings.line_file import AS_LINES, LineReading

SOUND_SPEEDS = (1000.0, 2000.0)  # [m/s]; in water 1400 to 1600
# Axes of the points as a file has them -> rows of R_flu_file: forward, left and up in the file's axes.
FRAMES = {
    "flu": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # x forward, y left, z up
    "frd": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),  # x forward, y right, z down
    "rdf": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),  # x right, y down, z forward, as of cameras
    "ned": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),  # x North, y East, z down: scans that were leveled and turned North
}
# Name -> meters. The US survey foot is 1200/3937 m.
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}


@dataclass(frozen=True, slots=True)
class PointFrame:
    """The axes and the unit of the points in files. Raises InputError: another name."""

    axes: str = "flu"  # a name of FRAMES. The points of "ned" become East-North-Up, of the others forward-left-up.
    unit: str = "m"  # a name of UNITS

    def __post_init__(self) -> None:
        for given, known in ((self.axes, FRAMES), (self.unit, UNITS)):
            if given not in known:
                raise InputError(f"{given!r} is not known; choose one of {', '.join(known)}")

    def turned(self, cloud: Cloud) -> Cloud:
        """The cloud with points and viewpoints in meters, x forward, y left, z up."""
        if self == PointFrame():
            return cloud
        viewpoints = None if cloud.viewpoints is None else self._turned(cloud.viewpoints)
        return replace(cloud, points=self._turned(cloud.points), viewpoints=viewpoints)

    def _turned(self, points: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite are dropped later
            # axis by axis: a product would spread NaN over the others
            return np.stack([self._axis(points, row) for row in FRAMES[self.axes]], axis=1)

    def _axis(self, points: np.ndarray, row: tuple[int, int, int]) -> np.ndarray:
        (axis,) = np.flatnonzero(row).tolist()
        return points[:, axis].astype(np.float64) * (row[axis] * UNITS[self.unit])


AS_WE_HAVE_THEM = PointFrame()


@dataclass(frozen=True, slots=True)
class Corrections:
    """How to correct the points of scans. Raises InputError: a speed that is not water's, or a factor that is not above
    0."""

    # the right one [m/s], by whose ratio to that with which they were computed ranges are multiplied; None: are right
    sound_speed: float | None = None
    scale: float = 1.0  # a factor on the ranges besides, of any format
    frame: PointFrame = AS_WE_HAVE_THEM  # along which axes and in which unit files have their points
    lines: LineReading = AS_LINES  # how lines of pings become scans

    def __post_init__(self) -> None:
        low, high = SOUND_SPEEDS
        if self.sound_speed is not None and not low <= self.sound_speed <= high:
            raise InputError(
                f"`sound_speed={self.sound_speed:g}` is not a speed of sound in water; wanted {low:g} to {high:g} m/s, "
                "as 1497 or so"
            )
        if not (0 < self.scale < math.inf):
            raise InputError(f"`range_scale={self.scale:g}` is not a factor; wanted a number above 0, as 1.02")

    def corrected(self, cloud: Cloud) -> Cloud:
        """The cloud in our axes and meters, with right ranges from where its sensor was. Raises InputError: it does not
        say with which speed of sound its ranges were computed."""
        cloud, factor = self.frame.turned(cloud), self.scale
        if self.sound_speed is not None:
            if cloud.sound_speed is None:
                raise InputError(
                    "it does not say with which speed of sound its ranges were computed; give `range_scale` instead, "
                    "the right speed over the recorded one"
                )
            factor *= self.sound_speed / cloud.sound_speed
        if factor == 1.0:
            return cloud
        if cloud.viewpoints is None:
            return replace(cloud, points=factor * cloud.points)
        return replace(cloud, points=cloud.viewpoints + factor * (cloud.points - cloud.viewpoints))


AS_RECORDED = Corrections()
