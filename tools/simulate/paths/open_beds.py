"""Paths over open beds: a ring and lanes, the sensor's nose down where its fan does not look down by itself."""

import numpy as np

from tools.simulate.paths.smooth_path import Path, lane_path, lanes, spline_path
from tools.simulate.scenes.catalog import scene_kind

OPEN_BEDS = ("flatbed", "sandflat", "seabed", "shallow")
# In a scene of 256 m
DEPTH = -7.0  # of the sensor [m]
RING = (62.0, 50.0)  # half axes of the ring [m]
REACH = (66.0, 56.0)  # of the lanes to either side of the middle [m]
BEND = 13.0  # from where a turn between two lanes begins to its corner [m]
CORNERS = 10  # of the ring
NOSE_DOWN = np.deg2rad(25)  # of a sensor whose fan is level


def round_the_bed(scene: str, seed: int) -> Path:
    """A ring whose heading is that of travel."""
    scale = scene_kind(scene).scale
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    x, y = RING[0] * np.cos(angle), RING[1] * np.sin(angle)
    places = scale * np.column_stack([x, y, np.full(CORNERS, DEPTH)])
    return spline_path(np.column_stack([places, np.rad2deg(angle) + 90.0]), pitch=_pitch(scene))


def over_the_bed(scene: str, seed: int) -> Path:
    """Lanes and tie lines over the middle of the bed."""
    scale = scene_kind(scene).scale
    x, y = REACH
    corners = lanes((-x, -y), (x, y), 5, 4, east=True)
    places = np.column_stack([corners, np.full(len(corners), DEPTH)])
    return lane_path(scale * places, scale * BEND, _pitch(scene))


def _pitch(scene: str) -> float:
    return float(NOSE_DOWN) if scene_kind(scene).sensor == "sonar3d15" else 0.0
