"""Whole structures shifted out of the frame under noise of the voxels (Sect. 3, Figs. 12, 14, 15)."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.structures.moved import MovedStructures
from sonarmap.tools.lab.reproduce.structures.moved_section import draw_translation, translation_section
from sonarmap.tools.lab.reproduce.structures.settings import TranslationSettings

_DIRECTION = np.array([1.0, 2.0, 3.0])  # of every shift, x, y, z: a step is one such vector [m]


class Translation(MovedStructures):
    """The experiment."""

    name = "translation"
    make_section, draw_pictures = staticmethod(translation_section), staticmethod(draw_translation)

    def motions(self) -> list[RigidTransform]:
        """The shifts."""
        return [RigidTransform.from_translation(step * _DIRECTION) for step in self.settings.steps]


def create(request: Request) -> Translation:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "noises": ("D0", "D4", "D6"), "steps": (16, 30, 40)}
    return Translation(as_asked(TranslationSettings(), request, **quick), request.opened)
