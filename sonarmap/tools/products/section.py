"""A section: the points of a map along a line from one place to another, seen from the side, and their profile;
as a picture and tables."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import VERTICALS, Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.writers.atomic import all_or_none
from sonarmap.tools.files.writers.tables import write_table
from sonarmap.tools.products.report.pictures import write_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_CELLS = 1_000_000_000  # of a profile, with or without points


@dataclass(frozen=True, slots=True)
class PlacedMap:
    """One part of a map, of M points."""

    path: Path  # of the map's folder
    part: MapPart
    voxel: float  # [m]
    georeference: Georeference | None  # None where the part's place on the Earth is not known

    @classmethod
    def of(cls, folder: Map) -> "PlacedMap":
        """The largest part, without stray echoes."""
        part = folder.surface(folder.parts[0])
        if not len(part.points):
            raise InputError(f"the map of {folder.path} has no points; map again")
        here = folder.georeference if folder.on_earth(folder.parts[0]) else None
        return cls(folder.path, part, folder.voxel, here)

    def seen_by(self, least: int) -> "PlacedMap":
        """With only the points that at least `least` scans saw."""
        kept = self.part.columns["seen"] >= least
        if not kept.any():
            most = int(self.part.columns["seen"].max())
            raise InputError(
                f"no point of {self.path} was seen by {least} scans, at most by {most}; give a smaller --min-seen"
            )
        return replace(self, part=self.part.take(kept))

    @property
    def heights(self) -> np.ndarray:
        """(M,) float64 [m], positive up: above the vertical reference, or along the z axis of the map's frame."""
        return self.part.points[:, 2] + (0.0 if self.georeference is None else self.georeference.height)

    @property
    def height_words(self) -> str:
        """What heights are."""
        if self.georeference is None:
            return "z of the map's frame"
        return f"height above {VERTICALS[self.georeference.vertical]}"

    @property
    def upright(self) -> bool:
        return self.part.knows("tilt_x") and self.part.knows("tilt_y")


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Those in which places are given and said; the map's x and y [m] where nothing of the Earth is given."""

    georeference: Georeference | None = None
    projection: Projection | None = None  # for easting and northing [m]; None for latitude and longitude [deg]

    @property
    def names(self) -> str:
        """Of the two numbers, with their unit."""
        if self.georeference is None:
            return "x, y [m] of the map's frame"
        return "latitude, longitude [deg]" if self.projection is None else f"{self.projection.name} E, N [m]"

    def to_map(self, places: np.ndarray) -> np.ndarray:
        """(N, 2) x, y [m] in the map's frame of places (N, 2)."""
        if self.georeference is None:
            return places
        at_level = np.column_stack([places, np.full(len(places), self.georeference.height)])
        geodetic = at_level if self.projection is None else self.projection.unproject(at_level)
        return self.georeference.local(geodetic)[:, :2]

    def of_map(self, places: np.ndarray) -> np.ndarray:
        """(N, 2) places of x, y [m] (N, 2) in the map's frame: the inverse of `to_map`."""
        if self.georeference is None:
            return places
        geodetic = self.georeference.geodetic(np.column_stack([places, np.zeros(len(places))]))
        return (geodetic if self.projection is None else self.projection.project(geodetic))[:, :2]

    def said(self, place: np.ndarray) -> str:
        """One place (2,), to 1 cm."""
        digits = 7 if self.georeference is not None and self.projection is None else 2
        return ", ".join(f"{number:z.{digits}f}" for number in place.tolist())


@dataclass(frozen=True, slots=True)
class Section:
    """The points near a line, ordered by their distance along it."""

    line: np.ndarray  # (2, 2) float64 x, y [m] of start and end, in the map's frame
    width: float  # how far to either side points count [m]
    distance: np.ndarray  # (M,) float64 along the line from its start [m], 0 to `length`
    offset: np.ndarray  # (M,) float64 from the line [m], positive to the left
    height: np.ndarray  # (M,) float64 [m], as `PlacedMap.heights`
    place: np.ndarray  # (M, 2) float64 x, y [m] in the map's frame
    # sigma: (M,) standard deviation [m], scan: of which scan, seen: by how many
    sigma: np.ndarray
    scan: np.ndarray
    seen: np.ndarray

    @property
    def length(self) -> float:
        """Of the line [m]."""
        return float(np.linalg.norm(self.line[1] - self.line[0]))


@dataclass(frozen=True, slots=True)
class Profile:
    """The cells of a line that hold points, from its start on: all (K,)."""

    distance: np.ndarray  # of the cell's middle [m]
    place: np.ndarray  # (K, 2) x, y of the middle on the line [m], in the map's frame
    # height: the points' median [m]; lowest, highest: of the points [m]
    height: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    sigma: np.ndarray  # median of the points' standard deviations [m]: neighbors share the errors of their poses
    count: np.ndarray  # int64, number of points


def section_of(placed: PlacedMap, line: np.ndarray, width: float, given: Coordinates) -> Section:
    """The points of a map within `width` [m] to either side of a line (2, 2) from x, y to x, y [m].

    Args:
        given: the coordinates in which the user gave the line, for what is said of it."""
    start, end = (given.said(place) for place in given.of_map(line))
    length = float(np.linalg.norm(line[1] - line[0]))
    if not length > 0:
        raise InputError(f"--from and --to are both {start}; wanted two places, {given.names}: give another --to")
    along = (line[1] - line[0]) / length
    away = placed.part.points[:, :2] - line[0]
    distance, offset = away @ along, away @ np.array([-along[1], along[0]])
    chosen = np.flatnonzero((distance >= 0) & (distance <= length) & (np.abs(offset) <= width))
    if not len(chosen):
        low, high = placed.part.points.min(axis=0)[:2], placed.part.points.max(axis=0)[:2]
        corners = given.of_map(np.array([low, high, [low[0], high[1]], [high[0], low[1]]]))
        raise InputError(
            f"no point of {placed.path} lies within {width:g} m of the line from {start} to {end}; the map lies "
            f"between {given.said(corners.min(axis=0))} and {given.said(corners.max(axis=0))} ({given.names}): give "
            "--from and --to there, or a larger --width"
        )
    chosen = chosen[np.argsort(distance[chosen], kind="stable")]
    columns = (placed.part.columns[name][chosen] for name in ("sigma", "scan", "seen"))
    place = placed.part.points[chosen, :2]
    return Section(line, width, distance[chosen], offset[chosen], placed.heights[chosen], place, *columns)


def profile_of(section: Section, cell: float) -> Profile:
    """The median of the points in every cell of the line that holds any; `cell` is its length [m]. The last cell is
    shorter where the line ends in it."""
    length = section.length
    if length / cell > _MOST_CELLS:
        raise InputError(f"--cell {cell:g} m divides {length:.2f} m into more than {_MOST_CELLS:,}; give longer cells")
    last = max(int(np.ceil(length / cell)) - 1, 0)
    index = np.minimum((section.distance / cell).astype(np.int64), last)
    cells, first, count = np.unique(index, return_index=True, return_counts=True)
    height, sigma = (values[np.lexsort((values, index))] for values in (section.height, section.sigma))
    lower, upper = first + (count - 1) // 2, first + count // 2  # both the middle one where the number is odd
    middle = (cells * cell + np.minimum((cells + 1) * cell, length)) / 2
    return Profile(
        distance=middle,
        place=section.line[0] + middle[:, None] / length * (section.line[1] - section.line[0]),
        height=(height[lower] + height[upper]) / 2,
        lowest=height[first],
        highest=height[first + count - 1],
        sigma=(sigma[lower] + sigma[upper]) / 2,
        count=count,
    )


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
    """Refuse names that are neither of a picture nor of a table, and those in a map's own folder."""
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
        write_png(section_figure(section, profile, titles), out)
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
