"""How the scans of `sonarmap map` are put together: loops, key scans, motion."""

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from sonarmap.tools.command.options.groups import LOOPS, MOST, OUTPUT
from sonarmap.tools.command.options.option import option
from sonarmap.tools.command.options.registration import checked, is_positive

if TYPE_CHECKING:
    from sonarmap.slam.mapper import MapperSettings

_limit = partial(
    option,
    LOOPS,
    rare=True,
    callback=checked(is_positive, "{}; give a number above 0, or leave it out where it is not known"),
)


@dataclass(frozen=True, slots=True)
class SurveyOptions:
    """Loops, key scans, and what the vehicle's motion cannot exceed."""

    loops: int | None = option(
        LOOPS,
        "N",
        "Loops to try per scan and round. 0 is none. Loops that connect distant parts of the track come "
        "first. There are two rounds, and more as long as they improve the poses.",
        shown="2",
        min=0,
        max=MOST,
    )
    key_step: float | None = _limit(
        "M",
        "Distance of key scans \\[m]. Only these are registered, the others are placed between them.",
        shown="a dense stream: as suits it",
    )
    max_speed: float | None = _limit(
        "M/S", "How fast the vehicle moves at most \\[m/s]; for scans whose stamps are times.", shown="learned"
    )
    max_turn_rate: float | None = _limit(
        "DEG/S", "How fast it turns at most \\[deg/s]; for scans whose stamps are times.", shown="learned"
    )
    max_step: float | None = _limit("M", "How far apart consecutive scans are at most \\[m].", shown="learned")
    min_seen: int | None = option(
        OUTPUT,
        "N",
        "Leave out false echoes: points that fewer than N scans saw and other scans contradict. map_all.ply keeps all "
        "points; 1 leaves out none.",
        rare=True,
        shown="2",
        min=1,
        max=MOST,
    )

    def mapper_settings(self) -> "MapperSettings":
        """The same as the mapper takes it; None leaves the default."""
        from sonarmap.slam.loops.settings import LoopSettings
        from sonarmap.slam.map.component_maps import MIN_SEEN
        from sonarmap.slam.mapper import MapperSettings
        from sonarmap.slam.motion.limits import MotionLimits
        from sonarmap.slam.stream.keys import KeySettings

        limits = MotionLimits(
            speed=math.inf if self.max_speed is None else self.max_speed,
            turn_rate=math.inf if self.max_turn_rate is None else math.radians(self.max_turn_rate),
            step=math.inf if self.max_step is None else self.max_step,
        )
        return MapperSettings(
            LoopSettings() if self.loops is None else LoopSettings(per_scan=self.loops),
            limits,
            KeySettings(self.key_step),
            min_seen=MIN_SEEN if self.min_seen is None else self.min_seen,
        )
