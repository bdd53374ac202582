"""What the experiment on growth runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.checks import check_seeds


@dataclass(frozen=True, slots=True)
class ScaleSettings:
    """What is run.

    Attributes:
        counts: numbers of scans, ascending.
        points: of each scan.
        seeds, first_seed: how many surveys of each number, counted from the first.
        voxel: edge of the survey's voxels [m].
    """

    counts: tuple[int, ...] = (1000, 3000, 10_000)
    points: int = 25_000
    seeds: int = 1
    first_seed: int = 7
    voxel: float = 0.5

    def __post_init__(self) -> None:
        check_seeds(self.seeds, self.first_seed)
        if not self.counts or min(self.counts) < 10 or self.points < 100:
            raise InputError(f"{self.counts} scans of {self.points} points; wanted 10 or more of 100 or more")
