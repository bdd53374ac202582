"""What is done to points once, when they are read: turned to our axes, into meters, their ranges corrected."""

import math
from dataclasses import dataclass, replace

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.point_frame import AS_WE_HAVE_THEM, PointFrame

SOUND_SPEEDS = (1000.0, 2000.0)  # [m/s]; in water 1400 to 1600


@dataclass(frozen=True, slots=True)
class Corrections:
    """How to correct the points of scans.

    Attributes:
        sound_speed: the right one [m/s]; ranges are multiplied by its ratio to that with which they were computed, each
            scan by its own. None: they are right.
        scale: a factor on the ranges besides, of any format.
        frame: along which axes and in which unit files have their points.

    Raises InputError: a speed that is not water's, or a factor that is not above 0.
    """

    sound_speed: float | None = None
    scale: float = 1.0
    frame: PointFrame = AS_WE_HAVE_THEM

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
