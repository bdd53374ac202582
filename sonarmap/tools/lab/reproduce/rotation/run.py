"""Whole structures turned under noise of the voxels (Sect. 3, Figs. 16, 17)."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.rotation.section import PICTURE, rotation_section
from sonarmap.tools.lab.reproduce.rotation.settings import RotationSettings
from sonarmap.tools.lab.reproduce.rows import all_rows, where
from sonarmap.tools.lab.reproduce.structures.figure import draw_series
from sonarmap.tools.lab.reproduce.structures.settings import Structures, as_asked


class Turns(Structures):
    """The experiment."""

    name: ClassVar[str] = "rotation"

    def __init__(self, settings: RotationSettings, device: Device) -> None:
        """Nothing is planned on the device before a job is run."""
        self.settings = settings
        angles = [(yaw, settings.tilt_deg, settings.tilt_deg) for yaw in settings.yaws_deg]
        turns = [RigidTransform.from_rotation(Rotation.from_euler("ZYX", a, degrees=True)) for a in angles]
        super().__init__(settings, turns, device)

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The deviations under every noise, next to the paper's."""
        return rotation_section(all_rows(outcomes), self.settings, self.series.grid)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """The first seed of the first scene, as the paper's figures show it."""
        first = where(all_rows(outcomes), scene=self.settings.scenes[0], seed=self.settings.first_seed)
        draw_series(folder / PICTURE, first, self.settings.noises, "true_yaw_deg", "true yaw [degrees]")


def create(request: Request) -> Turns:
    """The experiment as the command line asks for it."""
    quick = {"noises": ("D0", "D4"), "yaws_deg": (8, 32, 64, 88)}
    return Turns(as_asked(RotationSettings(), quick, request), request.opened)
