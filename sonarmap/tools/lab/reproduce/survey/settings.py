"""What the experiment on whole surveys runs."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.settings import check_scenes, check_seeds
from sonarmap.tools.lab.reproduce.survey.mapped import SYSTEMS

DIVES = "dives"


@dataclass(frozen=True, slots=True)
class SurveySettings:
    """What is run.

    Attributes:
        scene: a key of SCENE_KINDS.
        seeds: how many surveys, each with a scene, a sea and a noise of its own, counted from `first_seed`.
        first_seed: >= 0.
        counts: of the scans of a survey; the peers map the longest alone.
        dive: scans of each of two dives over one place; 0 for none.
        unusable: share of the scans that show nothing of the scene.
        edge: voxels per edge; their size is chosen for the survey, as `sonarmap map` does.
        systems: of SYSTEMS.
        left_out: systems that would have run were their packages installed.
    """

    scene: str = "floodgate"
    seeds: int = 1
    first_seed: int = 5
    counts: tuple[int, ...] = (50, 100, 200)
    dive: int = 60
    unusable: float = 0.03
    edge: int = 128
    systems: tuple[str, ...] = SYSTEMS
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_scenes((self.scene,))
        check_seeds(self.seeds, self.first_seed)
        if not self.counts or min(self.counts) < 2 or self.dive < 0:
            raise InputError(f"{self.counts} scans and dives of {self.dive}; a survey needs 2 scans or more")
