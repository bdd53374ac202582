"""A finished map as its verbs take it: read under its lock, and placed where the user says that it lies."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.command.options.output import EarthPlace
from sonarmap.tools.command.terminal import say
from sonarmap.tools.files.writers.atomic import locked

if TYPE_CHECKING:
    from sonarmap.tools.files.map_folder.folder import Map


SAME_FRAME = "Both are in one frame, by their places on the Earth or else as they are; register nothing."


def open_map(path: Path, earth: EarthPlace | None = None) -> "Map":
    """The map; of several parts the largest counts."""
    from sonarmap.tools.files.map_folder.folder import read_map_folder

    with locked(path, writing=False):
        folder = read_map_folder(path)
    if len(folder.parts) > 1:
        say(f"{path} has {len(folder.parts)} parts; using the largest")
    return folder if earth is None else replace(folder, georeference=earth.georeference(folder.georeference))
