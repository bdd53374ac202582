# pyright: strict
"""Formats that hold a map as it is, in its own frame: what `map --also` writes, beside exports that have a place."""

from pathlib import Path

from tools.export.georeferenced import Georeferenced
from tools.export.map_folder import MapFolder, MapPart
from tools.writers.points import write_points
from tools.writers.trajectory import write_trajectory


def write_cloud(path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced | None) -> None:
    """Write the points and all their columns in the format that the suffix of `path` names.

    Raises:
        InputError: the file cannot be written.
    """
    write_points(path, part.points, part.columns)


def write_poses(path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced | None) -> None:
    """Write the poses in the format that the suffix of `path` names.

    Raises:
        InputError: the file cannot be written.
    """
    write_trajectory(path, part.trajectory)
