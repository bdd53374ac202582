"""Whole structures shifted out of the frame under noise of the voxels (Sect. 3, Figs. 12, 14, 15)."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.figure import draw_series
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.structures.moved import MovedStructures
from sonarmap.tools.lab.reproduce.structures.settings import TranslationSettings
from sonarmap.tools.lab.reproduce.structures.translation_section import PICTURES, translation_section

_DIRECTION = np.array([1.0, 2.0, 3.0])  # of every shift, x, y, z: a step is one such vector [m]


class Translation(MovedStructures):
    """The experiment."""

    name: ClassVar[str] = "translation"

    @property
    def motions(self) -> list[RigidTransform]:
        """The shifts."""
        return [RigidTransform.from_translation(step * _DIRECTION) for step in self.settings.steps]

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """The reach under every noise, next to the paper's."""
        return translation_section(rows, self.settings)

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = where(rows, scene=self.settings.scenes[0], seed=self.settings.first_seed)
        for name, (_, noises) in PICTURES.items():
            if drawn := [noise for noise in noises if noise in self.settings.noises]:
                draw_series(folder / name, first, drawn, "distance_m", "true distance [m]")


def create(request: Request) -> Translation:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "noises": ("D0", "D4", "D6"), "steps": (16, 30, 40)}
    return Translation(as_asked(TranslationSettings(), request, **quick), request.opened)
