"""What the translation experiment runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.structures.settings import StructureSettings


@dataclass(frozen=True, slots=True)
class TranslationSettings(StructureSettings):
    """What is run.

    Attributes:
        steps: the shifts, in steps of (1, 2, 3) m, ascending.
    """

    steps: tuple[int, ...] = (4, 8, 12, 16, 20, 24, 28, 30, 32, 34, 36, 38, 40, 44, 48, 52, 56, 60)

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        if not self.steps or min(self.steps) < 0 or list(self.steps) != sorted(set(self.steps)):
            raise InputError(f"steps are {self.steps}; there must be at least one, each farther than the one before")
