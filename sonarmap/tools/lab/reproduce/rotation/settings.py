"""What the rotation experiment runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.structures.settings import StructureSettings


@dataclass(frozen=True, slots=True)
class RotationSettings(StructureSettings):
    """What is run.

    Attributes:
        tilt_deg: roll and pitch, both [degrees].
        yaws_deg: [degrees], ascending, above -90 and below 90.
    """

    noises: tuple[str, ...] = ("D0", "D2", "D4", "D6")
    tilt_deg: float = 10.0
    yaws_deg: tuple[float, ...] = tuple(range(8, 89, 8))

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        yaws = list(self.yaws_deg)
        if not yaws or yaws != sorted(set(yaws)) or not -90 < yaws[0] <= yaws[-1] < 90:
            raise InputError(
                f"yaws_deg are {self.yaws_deg}; there must be at least one, ascending, above -90 and below 90 degrees"
            )
