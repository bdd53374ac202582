# pyright: strict
"""The files of a section: a picture, its points, its profile."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import all_or_none
from sonarmap.tools.files.writers.table import write_table
from sonarmap.tools.products.section.picture import Titles, draw_section
from sonarmap.tools.products.section.placed import Coordinates
from sonarmap.tools.products.section.section import Profile, Section

POINTS = ("distance_m", "height_m", "sigma_m", "x_m", "y_m", "scan", "seen", "offset_m")
PROFILE = ("distance_m", "height_m", "lowest_m", "highest_m", "sigma_m", "points", "x_m", "y_m")
WORLD = ("easting_m", "northing_m")


def check_names(out: Path, folder: Path) -> None:
    """Refuse names that are neither of a picture nor of a table, and those in a map's own folder.

    Raises InputError: saying which to give."""
    if out.suffix.lower() not in (".png", ".csv"):
        raise InputError(f"-o is {out}; wanted a name that ends in .png, or .csv for the tables alone")
    if out.parent.resolve() == folder.resolve():
        raise InputError(f"-o {out} lies in the map's folder, whose files `map` writes; choose another folder")


def write_section(
    out: Path, section: Section, profile: Profile, titles: Titles, world: Coordinates | None
) -> Sequence[Path]:
    """Write NAME.csv with the points, NAME_profile.csv and, where `out` ends in .png, the picture; all or none.

    Args:
        world: for easting and northing of every row; None where the map's place on the Earth is not known.

    Returns:
        The files.
    """
    tables = out.with_suffix(".csv"), out.with_name(f"{out.stem}_profile.csv")
    points = [section.distance, section.height, section.sigma, *section.place.T]
    numbers = [section.scan, section.seen, section.offset]
    medians = [profile.distance, profile.height, profile.lowest, profile.highest, profile.sigma, profile.count]
    with all_or_none():
        _write(tables[0], POINTS, [*points, *numbers], section.place, world)
        _write(tables[1], PROFILE, [*medians, *profile.place.T], profile.place, world)
        if out.suffix.lower() == ".csv":
            return tables
        draw_section(out, section, profile, titles)
    return out, *tables


def _write(
    path: Path, names: Sequence[str], columns: Sequence[np.ndarray], place: np.ndarray, world: Coordinates | None
) -> None:
    """Whole numbers as they are, others to 0.1 mm."""
    more = () if world is None else world.of_map(place).T
    texts = [
        [str(value) for value in column.tolist()] if column.dtype.kind in "iu" else [f"{x:z.4f}" for x in column]
        for column in (*columns, *more)
    ]
    write_table(path, (*names, *(WORLD if world else ())), zip(*texts, strict=True))
