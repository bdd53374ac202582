"""Which surveys are decided about."""

from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.settings import check_scenes, check_seeds
from sonarmap.tools.lab.simulate.kinds.kind import ROUGH_SCENES


@dataclass(frozen=True, slots=True)
class DecisionSettings:
    """What is run."""

    scenes: tuple[str, ...] = ROUGH_SCENES  # keys of SCENE_KINDS
    seeds: int = 5  # surveys of each scene, counted from `first_seed`
    first_seed: int = 7202  # >= 0
    scans: int = 24  # of each survey, by the usual sensor
    edge: int = 128  # voxels per edge; their size is chosen for the survey, as `sonarmap map` does

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_scenes(self.scenes)
        check_seeds(self.seeds, self.first_seed)
        if self.scans < 2:
            raise InputError(f"{self.scans} scans; a survey needs 2 or more")
