"""Whole structures turned under noise of the voxels (Sect. 3, Figs. 16, 17)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from scipy.spatial.transform import RigidTransform, Rotation

from kernels.device import Device
from kernels.errors import InputError
from tools.reproduce.experiment import Outcome, Section
from tools.reproduce.experiments import Request
from tools.reproduce.rotation_figure import PICTURE, draw_rotation
from tools.reproduce.rotation_section import rotation_section
from tools.reproduce.voxel_series import Case, VoxelSeries, all_rows, cases, picked


@dataclass(frozen=True, slots=True)
class RotationSettings:
    """What is run.

    Attributes:
        scenes: keys of SCENES.
        noises: keys of NOISES.
        seeds: how many structures and noises, counted from `first_seed`.
        first_seed: >= 0.
        edge: voxels per edge of the grid of 256 m.
        tilt_deg: roll and pitch, both [degrees].
        yaws_deg: [degrees], ascending, above -90 and below 90.
    """

    scenes: tuple[str, ...] = ("floodgate", "clutter")
    noises: tuple[str, ...] = ("D0", "D2", "D4", "D6")
    seeds: int = 2
    first_seed: int = 1
    edge: int = 256
    tilt_deg: float = 10.0
    yaws_deg: tuple[float, ...] = tuple(range(8, 89, 8))

    def __post_init__(self) -> None:
        yaws = list(self.yaws_deg)
        if not yaws or yaws != sorted(set(yaws)) or not -90 < yaws[0] <= yaws[-1] < 90:
            raise InputError(f"yaws_deg are {self.yaws_deg}; wanted some, ascending, above -90 and below 90 degrees")
        self.cases()

    def cases(self) -> list[Case]:
        """Every series."""
        return cases(self.scenes, self.noises, range(self.first_seed, self.first_seed + self.seeds))


class RotationSeries:
    """The experiment: one job per scene, seed and noise."""

    name: ClassVar[str] = "rotation"

    def __init__(self, settings: RotationSettings, device: Device) -> None:
        """Nothing is planned on the device before a job is run."""
        self.settings = settings
        self._series = VoxelSeries(device, settings.edge)

    def jobs(self) -> Sequence[str]:
        """As in "floodgate/D0/1"."""
        return [case.key for case in self.settings.cases()]

    def run(self, job: str) -> Outcome:
        """All yaws of one series."""
        tilt = self.settings.tilt_deg
        angles = [(yaw, tilt, tilt) for yaw in self.settings.yaws_deg]
        turns = [RigidTransform.from_rotation(Rotation.from_euler("ZYX", a, degrees=True)) for a in angles]
        return self._series.run(Case.of(job), turns)

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The deviations of every noise beside the paper's."""
        return rotation_section(all_rows(outcomes), self.settings, self._series.grid)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = picked(all_rows(outcomes), scene=self.settings.scenes[0], seed=self.settings.first_seed)
        draw_rotation(folder / PICTURE, first, self.settings.noises)


def create(request: Request) -> RotationSeries:
    """The experiment as the command line asks for it."""
    settings = RotationSettings()
    if request.quick:
        settings = replace(settings, scenes=settings.scenes[:1], noises=("D0", "D4"), seeds=1, yaws_deg=(8, 32, 64, 88))
    return RotationSeries(
        replace(
            settings,
            scenes=settings.scenes if request.scene is None else (request.scene,),
            seeds=request.seeds or settings.seeds,
            first_seed=settings.first_seed if request.seed is None else request.seed,
            edge=request.grid or settings.edge,
        ),
        request.opened,
    )
