"""What the experiment on Table 1 runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.checks import check_seeds, check_variances
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS

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
        check_variances(self.sigma2)
        check_seeds(self.seeds, self.first_seed)
        for edge in self.edges:
            grid_of(edge)


def grid_of(edge: int) -> Grid:
    """The grid that all pairs of so many voxels share."""
    Grid(edge, 1.0)
    return Grid(edge, EXTENT / edge)
