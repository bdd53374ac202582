"""Whole structures turned under noise of the voxels (Sect. 3, Figs. 16, 17)."""

from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.structures.moved import MovedStructures
from sonarmap.tools.lab.reproduce.structures.moved_section import draw_rotation, rotation_section
from sonarmap.tools.lab.reproduce.structures.settings import RotationSettings


class Turns(MovedStructures):
    """The experiment."""

    name = "rotation"
    make_section, draw_pictures = staticmethod(rotation_section), staticmethod(draw_rotation)

    def motions(self) -> list[RigidTransform]:
        """The turns about the middle of the grid."""
        tilt = self.settings.tilt_deg
        angles = [(yaw, tilt, tilt) for yaw in self.settings.yaws_deg]
        return [RigidTransform.from_rotation(Rotation.from_euler("ZYX", turn, degrees=True)) for turn in angles]


def create(request: Request) -> Turns:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "noises": ("D0", "D4"), "yaws_deg": (8, 32, 64, 88)}
    return Turns(as_asked(RotationSettings(), request, **quick), request.opened)
