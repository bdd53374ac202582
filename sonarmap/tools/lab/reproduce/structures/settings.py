"""What the experiments on whole structures have in common: their settings, and their jobs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.checks import check_seeds
from sonarmap.tools.lab.reproduce.experiment import Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.structures.voxel_series import MovedStructure, VoxelSeries
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.shapes.structure import NOISES

SOURCES = ("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate", "tools/lab/reproduce/structures")


@dataclass(frozen=True, slots=True)
class StructureSettings:
    """What is run.

    Attributes:
        scenes: keys of SCENE_KINDS.
        noises: keys of NOISES.
        seeds: how many structures and noises of each scene, counted from `first_seed`.
        first_seed: >= 0.
        edge: voxels per edge of the grid of 256 m.
    """

    scenes: tuple[str, ...] = ("floodgate", "clutter")
    noises: tuple[str, ...] = tuple(NOISES)
    seeds: int = 2
    first_seed: int = 1
    edge: int = 256

    def __post_init__(self) -> None:
        for given, known in ((self.scenes, SCENE_KINDS), (self.noises, NOISES)):
            strange = [name for name in given if name not in known]
            if strange or not given:
                raise InputError(f"{strange[0] if strange else 'nothing'}: choose from {', '.join(known)}")
        check_seeds(self.seeds, self.first_seed)

    @property
    def structures(self) -> list[tuple[str, int]]:
        """Every scene with every seed."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return [(scene, seed) for scene in self.scenes for seed in seeds]

    @property
    def cases(self) -> list[MovedStructure]:
        """Every structure under every noise."""
        return [MovedStructure(scene, noise, seed) for scene, seed in self.structures for noise in self.noises]


Settings = TypeVar("Settings", bound=StructureSettings)


def as_asked(settings: Settings, quick: dict[str, Any], request: Request) -> Settings:
    """Settings as the command line asks for them: less of everything if it is to be quick, and what the options say.

    Args:
        quick: the settings that a quick run changes, beside taking one structure.
    """
    if request.quick:
        settings = replace(settings, scenes=settings.scenes[:1], seeds=1, **quick)
    given = {
        "scenes": None if request.scene is None else (request.scene,),
        "seeds": request.seeds,
        "first_seed": request.seed,
        "edge": request.grid,
    }
    return replace(settings, **{name: value for name, value in given.items() if value is not None})


class Structures:
    """An experiment that moves structures in one way, under noise: one job per scene, seed and noise."""

    sources: ClassVar[tuple[str, ...]] = SOURCES

    def __init__(self, settings: StructureSettings, motions: Sequence[RigidTransform], device: Device) -> None:
        """Nothing is planned on the device before a job is run.

        Args:
            settings: which structures.
            motions: T_target_source, in order: each moves every structure.
            device: to run on.
        """
        self._cases, self._motions = settings.cases, motions
        self.series = VoxelSeries(device, settings.edge)

    def jobs(self) -> Sequence[str]:
        """As in "floodgate/D0/1"."""
        return [case.key for case in self._cases]

    def run(self, job: str) -> Outcome:
        """All motions of one series."""
        return self.series.run(MovedStructure.of(job), self._motions)
