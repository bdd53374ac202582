"""What the experiment on the limits of roll, pitch and yaw runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.structures.settings import StructureSettings


@dataclass(frozen=True, slots=True)
class LimitsSettings(StructureSettings):
    """What is run.

    Attributes:
        tilts_deg: of roll, of pitch, and of both at once [degrees], ascending, above 0.
        yaws_deg: under each tilt and without [degrees], ascending, above -90 and below 90.
    """

    noises: tuple[str, ...] = ("D0",)
    edge: int = 128
    tilts_deg: tuple[float, ...] = (5, 10, 15, 20, 25, 30, 35)
    yaws_deg: tuple[float, ...] = (-80, -40, 0, 40, 80)

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        for name, angles, low in (("tilts_deg", self.tilts_deg, 0), ("yaws_deg", self.yaws_deg, -90)):
            if not angles or list(angles) != sorted(set(angles)) or not low < angles[0] <= angles[-1] < 90:
                raise InputError(
                    f"{name} are {angles}; there must be at least one, ascending, above {low} and below 90 degrees"
                )
