"""Limits of a vehicle's motion, stated by a user."""

from dataclasses import dataclass
from math import inf, pi

from sonarmap.kernels.errors import InputError


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """The largest motion of a vehicle; infinite where unknown.

    Attributes:
        speed: [m/s]; like the turn rate, it needs stamps that are times.
        turn_rate: about any axis [rad/s].
        step: between consecutive scans [m].

    Raises:
        InputError: one that is not above 0.
    """

    speed: float = inf
    turn_rate: float = inf
    step: float = inf

    def __post_init__(self) -> None:
        for name, unit in (("speed", "m/s"), ("turn_rate", "rad/s"), ("step", "m")):
            if not getattr(self, name) > 0:
                raise InputError(f"`max_{name}` is {getattr(self, name)} {unit}; wanted more than 0")

    @property
    def any(self) -> bool:
        """Whether there is a limit."""
        return min(self.speed, self.turn_rate, self.step) < inf

    def way(self, time: float, scans: int) -> float:
        """The largest distance [m] in a time [s] and a number of scans."""
        return min(self.speed * time, self.step * scans)

    def turn(self, time: float) -> float:
        """The largest rotation [rad] in a time [s], at most pi."""
        return min(self.turn_rate * time, pi)


NO_LIMITS = MotionLimits()
