"""Whole structures shifted out of the frame under noise of the voxels (Sect. 3, Figs. 12, 14, 15)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from kernels.opencl.device import Device
from tools.reproduce.experiment import Outcome, Section
from tools.reproduce.experiments import Request
from tools.reproduce.structures.figure import draw_series
from tools.reproduce.structures.settings import Structures, StructureSettings, as_asked
from tools.reproduce.structures.voxel_series import all_rows, picked
from tools.reproduce.translation.section import PICTURES, translation_section

_DIRECTION = np.array([1.0, 2.0, 3.0])  # of every shift, x, y, z: a step is one such vector [m]


@dataclass(frozen=True, slots=True)
class TranslationSettings(StructureSettings):
    """What is run.

    Attributes:
        steps: the shifts, in steps of (1, 2, 3) m, ascending.
    """

    steps: tuple[int, ...] = (4, 8, 12, 16, 20, 24, 28, 30, 32, 34, 36, 38, 40, 44, 48, 52, 56, 60)

    def __post_init__(self) -> None:
        StructureSettings.__post_init__(self)
        if not self.steps or min(self.steps) < 0 or list(self.steps) != sorted(set(self.steps)):
            raise InputError(f"steps are {self.steps}; wanted some, each farther than the one before")


class Translation(Structures):
    """The experiment."""

    name: ClassVar[str] = "translation"

    def __init__(self, settings: TranslationSettings, device: Device) -> None:
        """Nothing is planned on the device before a job is run."""
        self.settings = settings
        shifts = [RigidTransform.from_translation(step * _DIRECTION) for step in settings.steps]
        super().__init__(settings, shifts, device)

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The reach of every noise beside the paper's."""
        return translation_section(all_rows(outcomes), self.settings, self.series.grid)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = picked(all_rows(outcomes), scene=self.settings.scenes[0], seed=self.settings.first_seed)
        for name, (_, noises) in PICTURES.items():
            if drawn := [noise for noise in noises if noise in self.settings.noises]:
                draw_series(folder / name, first, drawn, "distance_m", "true distance [m]")


def create(request: Request) -> Translation:
    """The experiment as the command line asks for it."""
    quick = {"noises": ("D0", "D4", "D6"), "steps": (16, 30, 40)}
    return Translation(as_asked(TranslationSettings(), quick, request), request.opened)
