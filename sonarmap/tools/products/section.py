"""Sections and volumes of a map. A section is the map's points near a line, seen from the side, and their profile, as a
picture and tables.

Volumes compare surfaces on a common lattice, with the cell heights of `products.export.grid`. Cut lies above the
target, a plane or another map, and fill is missing below it. Only cells that both surfaces have count; areas that only
one has are reported. The error of a pose, a small rotation and shift, moves all points of its scan: its variance of the
volume is J C J', with J the sum over the points of their areas times their upward motion. The correlation of two poses'
errors is unknown, so their standard deviations are added, an upper bound. A cell's sigma, and the scatter of all its
points about its height, count as independent between cells. Sigma is thus rather too large than too small
(docs/measured).
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import upward
from sonarmap.tools.files.geo import VERTICALS, Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.writers.atomic import all_or_none
from sonarmap.tools.files.writers.tables import write_table
from sonarmap.tools.products.export.grid import Cells, cells_of, check_size, weight_of
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
        """The largest part of a map, without stray echoes."""
        part = folder.surface(folder.parts[0])
        if not len(part.points):
            raise InputError(f"the map of {folder.path} has no points; map again")
        here = folder.georeference if folder.on_earth(folder.parts[0]) else None
        return cls(folder.path, part, folder.voxel, here)

    def seen_by(self, least: int) -> "PlacedMap":
        """The same part with only the points that at least `least` scans saw."""
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
        """Meaning of the heights."""
        if self.georeference is None:
            return "z of the map's frame"
        return f"height above {VERTICALS[self.georeference.vertical]}"

    @property
    def upright(self) -> bool:
        return self.part.knows("tilt_x") and self.part.knows("tilt_y")


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Horizontal coordinates of input and output; the map's x and y [m] without a projection."""

    georeference: Georeference | None = None
    projection: Projection | None = None  # for easting and northing [m]

    @property
    def names(self) -> str:
        """Names of the two numbers, with their unit."""
        return "x, y [m] of the map's frame" if self.projection is None else f"{self.projection.name} E, N [m]"

    def to_map(self, places: np.ndarray) -> np.ndarray:
        """(N, 2) x, y [m] in the map's frame, from places (N, 2) in these coordinates."""
        if self.georeference is None or self.projection is None:
            return places
        with_height = np.column_stack([places, np.full(len(places), self.georeference.height)])
        return self.georeference.local(self.projection.unproject(with_height))[:, :2]

    def of_map(self, places: np.ndarray) -> np.ndarray:
        """(N, 2) places in these coordinates, from x, y [m] (N, 2) in the map's frame: the inverse of `to_map`."""
        if self.georeference is None or self.projection is None:
            return places
        geodetic = self.georeference.geodetic(np.column_stack([places, np.zeros(len(places))]))
        return self.projection.project(geodetic)[:, :2]

    def said(self, place: np.ndarray) -> str:
        """A place (2,) in words, to 1 cm."""
        return ", ".join(f"{number:z.2f}" for number in place.tolist())


@dataclass(frozen=True, slots=True)
class Section:
    """The points near a line, ordered by their distance along it."""

    line: np.ndarray  # (2, 2) float64 x, y [m] of start and end, in the map's frame
    width: float  # largest distance of points from the line [m]
    distance: np.ndarray  # (M,) float64 along the line from its start [m], 0 to `length`
    offset: np.ndarray  # (M,) float64 from the line [m], positive to the left
    height: np.ndarray  # (M,) float64 [m], as `PlacedMap.heights`
    place: np.ndarray  # (M, 2) float64 x, y [m] in the map's frame
    # sigma: (M,) standard deviation [m]; scan: index of the main scan; seen: number of scans that saw the point
    sigma: np.ndarray
    scan: np.ndarray
    seen: np.ndarray

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return float(np.linalg.norm(self.line[1] - self.line[0]))


@dataclass(frozen=True, slots=True)
class Profile:
    """The K cells of a line that hold points, from its start."""

    distance: np.ndarray  # (K,) of the cell's middle [m]
    place: np.ndarray  # (K, 2) x, y of the middle on the line [m], in the map's frame
    # (K,) median, lowest and highest height of the points [m]
    height: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    sigma: np.ndarray  # (K,) median of the points' sigmas [m], not that of a mean: neighbors share their poses' errors
    count: np.ndarray  # (K,) int64, number of points


def section_of(placed: PlacedMap, line: np.ndarray, width: float, given: Coordinates) -> Section:
    """The points of a map within `width` [m] of a line (2, 2) from x, y to x, y [m].

    Args:
        given: the coordinates in which the user gave the line, for error messages."""
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
    """Medians of the points in cells of the line, of length `cell` [m]; the last cell ends with the line."""
    length = section.length
    if length / cell > _MOST_CELLS:
        raise InputError(f"--cell {cell:g} m divides {length:.2f} m into more than {_MOST_CELLS:,}; give longer cells")
    last = max(int(np.ceil(length / cell)) - 1, 0)
    index = np.minimum((section.distance / cell).astype(np.int64), last)
    cells, first, count = np.unique(index, return_index=True, return_counts=True)
    height, sigma = (values[np.lexsort((values, index))] for values in (section.height, section.sigma))
    lower, upper = first + (count - 1) // 2, first + count // 2  # of the middle points, the same if count is odd
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


_WIDTH, _BESIDE, _HEIGHTS, _DPI = 9.2, (2.5, 1.8), (2.4, 6.4), 140  # width, margins, range of heights of the axes [in]
_LINE_LENGTH, _BELOW_LENGTH = 30, 110  # characters in a line: of the vertical axis' name, and below the title
_COLORS, _LINE = "viridis", "#D55E00"
_SIGMA_QUANTILES = (0.02, 0.98)  # at the ends of the color scale
_BROKEN = 2.5  # distance of medians that are not joined by a line [cells]
POINTS = ("distance_m", "height_m", "sigma_m", "x_m", "y_m", "scan", "seen", "offset_m")
PROFILE = ("distance_m", "height_m", "lowest_m", "highest_m", "sigma_m", "points", "x_m", "y_m")
WORLD = ("easting_m", "northing_m")


@dataclass(frozen=True, slots=True)
class Titles:
    """Texts and scale of a section's picture."""

    title: str
    below: str
    height: str  # the name of its vertical axis, without the unit
    exaggeration: float = 1.0  # of heights
    cell: float = 1.0  # length of the profile's cells [m]


def section_figure(section: Section, profile: Profile, titles: Titles) -> "Figure":
    """Figure of a section; a meter upward is as long as one along the line, times the exaggeration."""
    from matplotlib.figure import Figure

    tall = 1.15 * _WIDTH * float(np.ptp(section.height)) * titles.exaggeration / section.length
    size = _WIDTH + _BESIDE[0], float(np.clip(tall, *_HEIGHTS)) + _BESIDE[1]
    figure = Figure(figsize=size, dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect(titles.exaggeration, adjustable="datalim")
    axes.update_datalim([(0.0, section.height.min()), (section.length, section.height.max())])  # the whole line
    order = np.argsort(-section.sigma, kind="stable")  # points of smallest sigma on top
    least, most = np.quantile(section.sigma, _SIGMA_QUANTILES).tolist()
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
    """Refuse file names that end in neither .png nor .csv, and those in a map's own folder."""
    if out.suffix.lower() not in (".png", ".csv"):
        raise InputError(f"-o is {out}; wanted a name that ends in .png, or .csv for the tables alone")
    if out.parent.resolve() == folder.resolve():
        raise InputError(f"-o {out} lies in the map's folder, whose files `map` writes; choose another folder")


def write_section(
    out: Path, section: Section, profile: Profile, titles: Titles, world: Coordinates | None
) -> Sequence[Path]:
    """Write NAME.csv with the points, NAME_profile.csv and, if `out` ends in .png, the picture; all or none. With
    `world` every row has easting and northing. Returns the files."""
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
    """Write a table, floating-point numbers to 0.1 mm."""
    more = () if world is None else world.of_map(place).T
    texts = [
        [str(value) for value in column.tolist()] if column.dtype.kind in "iu" else [f"{x:z.4f}" for x in column]
        for column in (*columns, *more)
    ]
    write_table(path, (*names, *(WORLD if world else ())), zip(*texts, strict=True))


_MOST = 1e12  # bound on the cells along an edge, more than any grid may have


@dataclass(frozen=True, slots=True)
class Volume:
    """Volumes to remove from and to add to a map to get its target."""

    # volume and its standard deviation [m^3]; net is fill less cut
    cut: tuple[float, float]
    fill: tuple[float, float]
    net: tuple[float, float]
    cell: float  # edge of a cell [m]
    # areas that were compared, that only the map has, and that only the target has [m^2]
    compared: float
    map_only: float
    target_only: float

    @property
    def as_json(self) -> Mapping[str, float]:
        pairs = {"cut": self.cut, "fill": self.fill, "net": self.net}
        volumes = {f"{name}_m3": volume for name, (volume, _) in pairs.items()}
        volumes |= {f"{name}_sigma_m3": sigma for name, (_, sigma) in pairs.items()}
        areas = {"compared": self.compared, "map_only": self.map_only, "target_only": self.target_only}
        return volumes | {"cell_m": self.cell} | {f"area_{name}_m2": area for name, area in areas.items()}


def volume_to_level(placed: PlacedMap, level: float, cell: float, kind: str = "top") -> Volume:
    """Volumes from a map to a horizontal plane at height `level` [m], as of `PlacedMap.heights`.

    Args:
        cell: edge of a cell [m].
        kind: of the cells' heights, a name of `formats.HEIGHTS`.
    """
    lattice = _lattice(cell, placed.part.points)
    surface = _Surface.of(placed, placed.part.points[:, :2], cell, lattice, kind)
    area = cell**2 * len(surface.key)
    return _summed(level - surface.cells.height, [(surface, np.arange(len(surface.key)))], cell, (area, 0.0, 0.0))


def volume_between(first: PlacedMap, second: PlacedMap, cell: float, kind: str = "top") -> Volume:
    """Volumes from one map to another: cut was lost, fill was gained. If both lie on the Earth, the second is
    transformed to the first one's frame; otherwise they have to share a frame."""
    points = second.part.points
    if first.georeference is not None and second.georeference is not None:
        one, other = first.georeference.vertical, second.georeference.vertical
        if one != other:
            raise InputError(
                f"heights of {first.path} count from {one!r}, those of {second.path} from {other!r}; wanted the same "
                "reference for both: map one again with --vertical, or lines with --heights"
            )
        points = first.georeference.local(second.georeference.geodetic(points))
    lattice = _lattice(cell, first.part.points, points)
    surfaces = (
        _Surface.of(first, first.part.points[:, :2], cell, lattice, kind),
        _Surface.of(second, points[:, :2], cell, lattice, kind),
    )
    _, *both = np.intersect1d(*(surface.key for surface in surfaces), assume_unique=True, return_indices=True)
    common = len(both[0])
    if not common:
        raise InputError(
            f"{first.path} and {second.path} have no cell of {cell:g} m in common; check them, or give a larger --cell"
        )
    change = surfaces[1].cells.height[both[1]] - surfaces[0].cells.height[both[0]]
    areas = (common, *(len(surface.key) - common for surface in surfaces))
    chosen = list(zip(surfaces, both, strict=True))
    return _summed(change, chosen, cell, (cell**2 * areas[0], cell**2 * areas[1], cell**2 * areas[2]))


@dataclass(frozen=True, slots=True)
class _Surface:
    """A map's surface of K cells on the lattice, from m points."""

    key: np.ndarray  # (K,) int64, the cell's number on the lattice, ascending
    cells: Cells
    spread: np.ndarray  # (K,) mean squared distance of all points of the cell from its height [m^2]
    cell: np.ndarray  # (m,) index of the point's cell
    scan: np.ndarray  # (m,) index of the point's pose
    lever: np.ndarray  # (m, 6) derivative of the cell's height [m] by rotation and shift of the pose [rad, m]
    covariances: np.ndarray  # (n, 6, 6) of the poses

    @classmethod
    def of(
        cls, placed: PlacedMap, flat: np.ndarray, cell: float, lattice: tuple[np.ndarray, int], kind: str
    ) -> "_Surface":
        """The surface of a map's points at x, y `flat` (M, 2) [m]; the lattice is that of `_lattice`."""
        column, row = (np.floor(flat / cell).astype(np.int64) - lattice[0]).T
        height, columns = placed.heights, placed.part.columns
        key, index, count = np.unique(row * lattice[1] + column, return_inverse=True, return_counts=True)
        highest = np.full(len(key), -np.inf)
        np.maximum.at(highest, index, height)
        below = {"top": placed.voxel, "mean": np.inf, "shoalest": 0.0}[kind]
        used = height >= highest[index] - below
        sigma = columns["sigma"][used]
        cells = cells_of(kind, row[used], column[used], height[used], sigma, columns["count"][used], placed.voxel)
        spread = np.bincount(index, (height - cells.height[index]) ** 2) / count
        used_cell, weight = index[used], weight_of(sigma)
        scan = np.searchsorted(placed.part.scans, columns["scan"][used])
        lever = upward(placed.part.trajectory.T_world_sensor[scan], placed.part.points[used])
        lever *= (weight / np.bincount(used_cell, weight)[used_cell])[:, None]
        return cls(key, cells, spread, used_cell, scan, lever, placed.part.covariances)

    def variance(self, chosen: np.ndarray) -> float:
        """Variance of the sum of the heights of the `chosen` cells (k,) [m^2]."""
        used = np.zeros(len(self.key), bool)
        used[chosen] = True
        points = used[self.cell]
        J = np.zeros((len(self.covariances), 6))
        np.add.at(J, self.scan[points], self.lever[points])
        by_poses = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", J, self.covariances, J), 0.0)).sum()
        return float(by_poses**2 + (self.cells.sigma[chosen] ** 2 + self.spread[chosen]).sum())


def _lattice(cell: float, *points: np.ndarray) -> tuple[np.ndarray, int]:
    """Lowest cell (2,) and number of columns of a lattice around all points, with edges at multiples of `cell`."""
    flat = np.concatenate([each[:, :2] for each in points])
    lower, upper = flat.min(axis=0), flat.max(axis=0)
    columns, rows = (int(min(extent / cell, _MOST)) + 1 for extent in (upper - lower).tolist())
    check_size(rows, columns, cell)
    low = np.floor(lower / cell).astype(np.int64)
    return low, int(np.floor(upper[0] / cell)) - int(low[0]) + 1


def _summed(
    change: np.ndarray, surfaces: list[tuple[_Surface, np.ndarray]], cell: float, areas: tuple[float, float, float]
) -> Volume:
    """The volumes of k cells with these changes of height (k,) [m], and with indices (k,) in every surface."""

    def volume(chosen: np.ndarray) -> tuple[float, float]:
        variance = sum(surface.variance(places[chosen]) for surface, places in surfaces)
        return cell**2 * float(np.abs(change[chosen].sum())), cell**2 * float(np.sqrt(variance))

    cut, fill, every = volume(change < 0), volume(change > 0), volume(np.ones(len(change), bool))
    return Volume(cut, fill, (fill[0] - cut[0], every[1]), cell, *areas)
