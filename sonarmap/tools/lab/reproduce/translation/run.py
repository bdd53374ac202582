"""Whole structures shifted out of the frame under noise of the voxels (Sect. 3, Figs. 12, 14, 15)."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.rows import all_rows, where
from sonarmap.tools.lab.reproduce.structures.figure import draw_series
from sonarmap.tools.lab.reproduce.structures.settings import Structures, as_asked
from sonarmap.tools.lab.reproduce.translation.section import PICTURES, translation_section
from sonarmap.tools.lab.reproduce.translation.settings import TranslationSettings

_DIRECTION = np.array([1.0, 2.0, 3.0])  # of every shift, x, y, z: a step is one such vector [m]


class TranslationExperiment(Structures):
    """The experiment."""

    name: ClassVar[str] = "translation"

    def __init__(self, settings: TranslationSettings, device: Device) -> None:
        """Nothing is planned on the device before a job is run."""
        self.settings = settings
        shifts = [RigidTransform.from_translation(step * _DIRECTION) for step in settings.steps]
        super().__init__(settings, shifts, device)

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The reach under every noise, next to the paper's."""
        return translation_section(all_rows(outcomes), self.settings, self.series.grid)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = where(all_rows(outcomes), scene=self.settings.scenes[0], seed=self.settings.first_seed)
        for name, (_, noises) in PICTURES.items():
            if drawn := [noise for noise in noises if noise in self.settings.noises]:
                draw_series(folder / name, first, drawn, "distance_m", "true distance [m]")


def create(request: Request) -> TranslationExperiment:
    """The experiment as the command line asks for it."""
    quick = {"noises": ("D0", "D4", "D6"), "steps": (16, 30, 40)}
    return TranslationExperiment(as_asked(TranslationSettings(), quick, request), request.opened)
