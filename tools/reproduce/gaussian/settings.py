"""What the experiment on Table 1 runs."""

from dataclasses import dataclass

import numpy as np

from kernels.errors import InputError
from spectral.grid import Grid
from tools.simulate.scenes.catalog import SCENE_KINDS

EXTENT = 256.0  # of the grid [m]; the paper has 256 voxels of about 1 m


# Windows, blurs and bounds were chosen on scenes and noises of smaller seeds.
FIRST_SEED = 11


@dataclass(frozen=True, slots=True)
class GaussianSettings:
    """What is run.

    Attributes:
        scene: a key of SCENE_KINDS.
        sigma2: variances of the range noise at the largest range [m^2], each.
        seeds: how many scenes and noises, counted from `first_seed`.
        first_seed: >= 0.
        edges: voxels per edge, each; the grid is as large as the paper's, whatever their number.
    """

    scene: str = "floodgate"
    sigma2: tuple[float, ...] = (1.0, 2.0)
    seeds: int = 10
    first_seed: int = FIRST_SEED
    edges: tuple[int, ...] = (128, 256)

    def __post_init__(self) -> None:
        if self.scene not in SCENE_KINDS:
            raise InputError(f"no scene is called {self.scene!r}; there are {', '.join(SCENE_KINDS)}")
        if not self.sigma2 or not all(np.isfinite(v) and v >= 0 for v in self.sigma2):
            given = ", ".join(f"{v:g}" for v in self.sigma2) or "no value"
            raise InputError(f"--sigma2: {given}; wanted variances of 0 m^2 or more, as in --sigma2 1 --sigma2 2")
        if self.seeds < 1 or self.first_seed < 0:
            raise InputError(
                f"{self.seeds} seeds from {self.first_seed} on; wanted at least one, and none below 0, "
                "as in --seeds 3 --seed 1"
            )
        for edge in self.edges:
            grid_of(edge)


def grid_of(edge: int) -> Grid:
    """The grid that all pairs of so many voxels share."""
    Grid(edge, 1.0)
    return Grid(edge, EXTENT / edge)
