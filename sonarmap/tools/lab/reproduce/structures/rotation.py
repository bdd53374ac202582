"""Whole structures turned under noise of the voxels (Sect. 3, Figs. 16, 17)."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.figure import draw_series
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.structures.moved import MovedStructures
from sonarmap.tools.lab.reproduce.structures.rotation_section import PICTURE, rotation_section
from sonarmap.tools.lab.reproduce.structures.settings import RotationSettings


class Turns(MovedStructures):
    """The experiment."""

    name: ClassVar[str] = "rotation"

    @property
    def motions(self) -> list[RigidTransform]:
        """The turns about the middle of the grid."""
        tilt = self.settings.tilt_deg
        angles = [(yaw, tilt, tilt) for yaw in self.settings.yaws_deg]
        return [RigidTransform.from_rotation(Rotation.from_euler("ZYX", turn, degrees=True)) for turn in angles]

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """The deviations under every noise, next to the paper's."""
        return rotation_section(rows, self.settings)

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = where(rows, scene=self.settings.scenes[0], seed=self.settings.first_seed)
        draw_series(folder / PICTURE, first, self.settings.noises, "true_yaw_deg", "true yaw [degrees]")


def create(request: Request) -> Turns:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "noises": ("D0", "D4"), "yaws_deg": (8, 32, 64, 88)}
    return Turns(as_asked(RotationSettings(), request, **quick), request.opened)
