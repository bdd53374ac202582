"""What the experiment on the steps of Table 1 runs."""

from dataclasses import dataclass, field

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.checks import check_seeds, check_variances
from sonarmap.tools.lab.reproduce.evaluation.methods import ComparedMethods
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS

EXTENT = 256.0  # of the grid [m], as large as the paper's


STEPS_SCENES = ("floodgate", "harbor", "bridge", "wreck")


FIRST_SEED = 101  # neither development nor the tests use scenes and noise of these seeds


@dataclass(frozen=True, slots=True)
class StepsSettings:
    """What is run.

    Attributes:
        scenes: keys of SCENE_KINDS; the seeds go round over them.
        sigma2: variances of the range noise at the largest range [m^2], each.
        seeds: how many scenes and noises, counted from `first_seed`.
        peers: how many of them, from the first, the methods other than ours register, as they take ten times as long.
        first_seed: >= 0.
        edge: voxels per edge; the grid is as large as the paper's, whatever their number.
        compared: the methods.
    """

    scenes: tuple[str, ...] = STEPS_SCENES
    sigma2: tuple[float, ...] = (1.0, 2.0, 4.0)
    seeds: int = 20
    peers: int = 12
    first_seed: int = FIRST_SEED
    edge: int = 128
    compared: ComparedMethods = field(default_factory=ComparedMethods)

    def __post_init__(self) -> None:
        unknown = [scene for scene in self.scenes if scene not in SCENE_KINDS]
        if unknown or not self.scenes:
            raise InputError(
                f"no scene is called {', '.join(unknown) or 'nothing'}; there are {', '.join(SCENE_KINDS)}"
            )
        check_variances(self.sigma2)
        check_seeds(self.seeds, self.first_seed)

    @property
    def grid(self) -> Grid:
        """That all pairs share."""
        Grid(self.edge, 1.0)
        return Grid(self.edge, EXTENT / self.edge)
