"""Paths over beds and what lies on them: a ring and lanes, nose down where the sensor's fan is level."""

import numpy as np

from sonarmap.tools.lab.simulate.paths.smooth_path import Path, lane_path, lanes, spline_path
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.scenes.scene import build_scene

BEDS = ("flatbed", "sandflat", "seabed", "shallow", "rubble")
# In a scene of 256 m
ABOVE = 12.0  # of the sensor over the highest thing [m]
SUBMERGED = 1.0  # at least [m]
RING = (62.0, 50.0)  # half axes of the ring [m]
REACH = (66.0, 56.0)  # of the lanes to either side of the middle [m]
BEND = 13.0  # from where a turn between two lanes begins to its corner [m]
CORNERS = 10  # of the ring
NOSE_DOWN = np.deg2rad(25)  # of a sensor whose fan is level


def round_the_bed(scene: str, seed: int) -> Path:
    """A ring whose heading is that of travel."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    places = _placed(np.column_stack([RING[0] * np.cos(angle), RING[1] * np.sin(angle)]), scene, seed)
    return spline_path(np.column_stack([places, np.rad2deg(angle) + 90.0]), pitch=_pitch(scene))


def over_the_bed(scene: str, seed: int) -> Path:
    """Lanes and tie lines over the middle of the bed."""
    corners = lanes((-REACH[0], -REACH[1]), REACH, 5, 4, east=True)
    return lane_path(_placed(corners, scene, seed), scene_kind(scene).scale * BEND, _pitch(scene))


def _placed(corners: np.ndarray, scene: str, seed: int) -> np.ndarray:
    """Corners (K, 2) of a scene of 256 m in this one's size, above everything and under the water, (K, 3) [m]."""
    scale = scene_kind(scene).scale
    top = float(build_scene(scene, seed).mesh.vertices[:, 2].max())
    return np.column_stack([scale * corners, np.full(len(corners), min(top + ABOVE * scale, -SUBMERGED * scale))])


def _pitch(scene: str) -> float:
    return float(NOSE_DOWN) if scene_kind(scene).sensor == "sonar3d15" else 0.0
