"""What the experiment on whole surveys runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.settings import check_scenes, check_seeds
from sonarmap.tools.lab.reproduce.survey.mapped import SYSTEMS

DIVES = "dives"


@dataclass(frozen=True, slots=True)
class SurveySettings:
    """What is run."""

    scene: str = "floodgate"  # a key of SCENE_KINDS
    seeds: int = 1  # how many surveys, each with a scene, a sea and a noise of its own, counted from `first_seed`
    first_seed: int = 5  # >= 0
    counts: tuple[int, ...] = (50, 100, 200)  # of the scans of a survey; the peers map the longest alone
    dive: int = 60  # scans of each of two dives over one place; 0 for none
    unusable: float = 0.03  # share of the scans that show nothing of the scene
    edge: int = 128  # voxels per edge; their size is chosen for the survey, as `sonarmap map` does
    systems: tuple[str, ...] = SYSTEMS  # of SYSTEMS
    left_out: tuple[str, ...] = ()  # systems that would have run were their packages installed

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_scenes((self.scene,))
        check_seeds(self.seeds, self.first_seed)
        if not self.counts or min(self.counts) < 2 or self.dive < 0:
            raise InputError(f"{self.counts} scans and dives of {self.dive}; a survey needs 2 scans or more")
