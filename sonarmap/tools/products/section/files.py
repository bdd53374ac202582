"""The files of a section: a picture, its points, its profile."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import all_or_none
from sonarmap.tools.files.writers.tables import write_table
from sonarmap.tools.products.png import write_png
from sonarmap.tools.products.section.section import Coordinates, Profile, Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH, _BESIDE, _HEIGHTS, _DPI = 9.2, (2.5, 1.8), (2.4, 6.4), 140  # of the axes, and of what is beside them [in]
_LINE_LENGTH, _BELOW_LENGTH = 30, 110  # characters: of the vertical axis' name, and of a line below the title
_COLORS, _LINE = "viridis", "#D55E00"
_SURE = (0.02, 0.98)  # quantiles of the sigmas between which the colors change
_BROKEN = 2.5  # cells between two medians from which on they are not joined
POINTS = ("distance_m", "height_m", "sigma_m", "x_m", "y_m", "scan", "seen", "offset_m")
PROFILE = ("distance_m", "height_m", "lowest_m", "highest_m", "sigma_m", "points", "x_m", "y_m")
WORLD = ("easting_m", "northing_m")


@dataclass(frozen=True, slots=True)
class Titles:
    """What a picture says of its section."""

    title: str
    below: str
    height: str  # the name of its vertical axis, without the unit
    exaggeration: float = 1.0  # of heights
    cell: float = 1.0  # of the profile [m]


def draw_section(path: Path, section: Section, profile: Profile, titles: Titles) -> None:
    """Write a PNG of a section. Raises InputError: the file cannot be written."""
    write_png(section_figure(section, profile, titles), path)


def section_figure(section: Section, profile: Profile, titles: Titles) -> "Figure":
    """The figure: a meter is as long upward as along the line, times the exaggeration."""
    from matplotlib.figure import Figure

    tall = 1.15 * _WIDTH * float(np.ptp(section.height)) * titles.exaggeration / section.length
    size = _WIDTH + _BESIDE[0], float(np.clip(tall, *_HEIGHTS)) + _BESIDE[1]
    figure = Figure(figsize=size, dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect(titles.exaggeration, adjustable="datalim")
    axes.update_datalim([(0.0, section.height.min()), (section.length, section.height.max())])  # the whole line
    order = np.argsort(-section.sigma, kind="stable")  # the surest on top
    least, most = np.quantile(section.sigma, _SURE).tolist()
    area = float(np.clip(4000 / np.sqrt(len(order)) / 6, 3, 26))
    dots = axes.scatter(
        section.distance[order], section.height[order], area, section.sigma[order], cmap=_COLORS, vmin=least, vmax=most
    )
    dots.set(edgecolor="none", rasterized=True)
    gaps = np.flatnonzero(np.diff(profile.distance) > _BROKEN * titles.cell) + 1  # medians are not joined across them
    x, y = (np.insert(values, gaps, np.nan) for values in (profile.distance, profile.height))
    axes.plot(x, y, ".-", markersize=3, color=_LINE, linewidth=1.2, label=f"median of every {titles.cell:.3g} m")
    axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
    axes.set_xlabel("distance along the line [m]")
    axes.set_ylabel(textwrap.fill(f"{titles.height} [m]", _LINE_LENGTH))
    axes.legend(loc="upper right", fontsize=9, framealpha=0.85, edgecolor="none")
    figure.colorbar(dots, ax=axes, label="sigma of the points [m]")
    figure.suptitle(textwrap.fill(titles.title, _BELOW_LENGTH), weight="bold")
    axes.set_title(textwrap.fill(titles.below, _BELOW_LENGTH), fontsize=10)
    return figure


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
