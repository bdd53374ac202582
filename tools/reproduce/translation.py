"""Whole structures shifted out of the frame under noise of the voxels (Sect. 3, Figs. 12, 14, 15)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.device import Device
from kernels.errors import InputError
from tools.reproduce.experiment import Outcome, Section
from tools.reproduce.experiments import Request
from tools.reproduce.translation_figure import PICTURES, draw_translation
from tools.reproduce.translation_section import translation_section
from tools.reproduce.voxel_series import Case, VoxelSeries, all_rows, cases, picked
from tools.simulate.voxel_noise import NOISES

_DIRECTION = np.array([1.0, 2.0, 3.0])  # of every shift, x, y, z: a step is one such vector [m]


@dataclass(frozen=True, slots=True)
class TranslationSettings:
    """What is run.

    Attributes:
        scenes: keys of SCENES.
        noises: keys of NOISES.
        seeds: how many structures and noises, counted from `first_seed`.
        first_seed: >= 0.
        edge: voxels per edge of the grid of 256 m.
        steps: the shifts, in steps of (1, 2, 3) m.
    """

    scenes: tuple[str, ...] = ("floodgate", "clutter")
    noises: tuple[str, ...] = tuple(NOISES)
    seeds: int = 2
    first_seed: int = 1
    edge: int = 256
    steps: tuple[int, ...] = (4, 8, 12, 16, 20, 24, 28, 30, 32, 34, 36, 38, 40, 44, 48, 52, 56, 60)

    def __post_init__(self) -> None:
        if not self.steps or min(self.steps) < 0 or list(self.steps) != sorted(set(self.steps)):
            raise InputError(f"steps are {self.steps}; wanted some, each farther than the one before")
        self.cases()

    def cases(self) -> list[Case]:
        """Every series."""
        return cases(self.scenes, self.noises, range(self.first_seed, self.first_seed + self.seeds))


class Translation:
    """The experiment: one job per scene, seed and noise."""

    name: ClassVar[str] = "translation"

    def __init__(self, settings: TranslationSettings, device: Device) -> None:
        """Nothing is planned on the device before a job is run."""
        self.settings = settings
        self._series = VoxelSeries(device, settings.edge)

    def jobs(self) -> Sequence[str]:
        """As in "floodgate/D0/1"."""
        return [case.key for case in self.settings.cases()]

    def run(self, job: str) -> Outcome:
        """All shifts of one series."""
        shifts = [RigidTransform.from_translation(step * _DIRECTION) for step in self.settings.steps]
        return self._series.run(Case.of(job), shifts)

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The reach of every noise beside the paper's."""
        return translation_section(all_rows(outcomes), self.settings, self._series.grid)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = picked(all_rows(outcomes), scene=self.settings.scenes[0], seed=self.settings.first_seed)
        for name, (_, noises) in PICTURES.items():
            if drawn := [noise for noise in noises if noise in self.settings.noises]:
                draw_translation(folder / name, first, drawn)


def create(request: Request) -> Translation:
    """The experiment as the command line asks for it."""
    settings = TranslationSettings()
    if request.quick:
        settings = replace(settings, scenes=settings.scenes[:1], noises=("D0", "D4", "D6"), seeds=1, steps=(16, 30, 40))
    return Translation(
        replace(
            settings,
            scenes=settings.scenes if request.scene is None else (request.scene,),
            seeds=request.seeds or settings.seeds,
            first_seed=settings.first_seed if request.seed is None else request.seed,
            edge=request.grid or settings.edge,
        ),
        request.opened,
    )
