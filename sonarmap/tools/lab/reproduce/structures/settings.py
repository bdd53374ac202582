"""What the experiments on whole structures run."""

from collections.abc import Sequence
from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.settings import check_scenes, check_seeds, paper_grid
from sonarmap.tools.lab.simulate.shapes.structure import NOISES

RIGHT_DEG, RIGHT_VOXELS = 2.0, 2.0


@dataclass(frozen=True, slots=True)
class StructureSettings:
    """What is run."""

    scenes: tuple[str, ...] = ("floodgate", "clutter")  # keys of SCENE_KINDS
    noises: tuple[str, ...] = tuple(NOISES)  # keys of NOISES
    seeds: int = 2  # how many structures and noises of each scene, counted from `first_seed`
    first_seed: int = 1  # >= 0
    edge: int = 256  # voxels per edge of the grid of 256 m

    def __post_init__(self) -> None:
        check_scenes(self.scenes)
        strange = [noise for noise in self.noises if noise not in NOISES]
        if strange or not self.noises:
            raise InputError(f"{strange[0] if strange else 'nothing'}: choose from {', '.join(NOISES)}")
        check_seeds(self.seeds, self.first_seed)

    @property
    def structures(self) -> list[tuple[str, int]]:
        """Every scene with every seed."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return [(scene, seed) for scene in self.scenes for seed in seeds]

    @property
    def grid(self) -> Grid:
        """Of all volumes."""
        return paper_grid(self.edge)


def check_angles(name: str, angles: Sequence[float], low: float) -> None:
    """Refuse angles [degrees] that do not ascend, or are not above `low` and below 90."""
    if not angles or list(angles) != sorted(set(angles)) or not low < angles[0] <= angles[-1] < 90:
        raise InputError(
            f"{name} are {angles}; there must be at least one, ascending, above {low:g} and below 90 degrees"
        )


@dataclass(frozen=True, slots=True)
class TranslationSettings(StructureSettings):
    """What is run."""

    # the shifts, in steps of (1, 2, 3) m, ascending
    steps: tuple[int, ...] = (4, 8, 12, 16, 20, 24, 28, 30, 32, 34, 36, 38, 40, 44, 48, 52, 56, 60)

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        if not self.steps or min(self.steps) < 0 or list(self.steps) != sorted(set(self.steps)):
            raise InputError(f"steps are {self.steps}; there must be at least one, each farther than the one before")


@dataclass(frozen=True, slots=True)
class RotationSettings(StructureSettings):
    """What is run."""

    noises: tuple[str, ...] = ("D0", "D2", "D4", "D6")
    tilt_deg: float = 10.0  # roll and pitch, both [degrees]
    yaws_deg: tuple[float, ...] = tuple(range(8, 89, 8))  # [degrees], ascending, above -90 and below 90

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        check_angles("yaws_deg", self.yaws_deg, -90)


@dataclass(frozen=True, slots=True)
class LimitsSettings(StructureSettings):
    """What is run."""

    noises: tuple[str, ...] = ("D0",)
    edge: int = 128
    # of roll, of pitch, and of both at once [degrees], ascending, above 0
    tilts_deg: tuple[float, ...] = (5, 10, 15, 20, 25, 30, 35)
    # under each tilt and without [degrees], ascending, above -90 and below 90
    yaws_deg: tuple[float, ...] = (-80, -40, 0, 40, 80)

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        check_angles("tilts_deg", self.tilts_deg, 0)
        check_angles("yaws_deg", self.yaws_deg, -90)
