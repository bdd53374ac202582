# pyright: strict
"""Formats that hold a map as it is, in its own frame: what `map --also` writes, beside exports that have a place."""

from pathlib import Path

from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
from sonarmap.tools.files.writers.points import write_points
from sonarmap.tools.files.writers.trajectory import write_trajectory
from sonarmap.tools.products.export.georeferenced import Georeferenced


def write_cloud(path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced | None) -> None:
    """Write the points and all their columns in the format that the suffix of `path` names."""
    write_points(path, part.points, part.columns)


def write_poses(path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced | None) -> None:
    """Write the poses in the format that the suffix of `path` names."""
    write_trajectory(path, part.trajectory)
