"""A section: the points of a map along a line from one place to another, seen from the side, and their profile."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import VERTICALS, Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart

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
        """The largest part, without stray echoes. Raises InputError: it has no points."""
        part = folder.surface(folder.parts[0])
        if not len(part.points):
            raise InputError(f"the map of {folder.path} has no points; map again")
        here = folder.georeference if folder.on_earth(folder.parts[0]) else None
        return cls(folder.path, part, folder.voxel, here)

    def seen_by(self, least: int) -> "PlacedMap":
        """With only the points that at least `least` scans saw. Raises InputError: there is none."""
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
        """(N, 2) x, y [m] in the map's frame of places (N, 2). Raises InputError: no such place, or one too far."""
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
        given: the coordinates in which the user gave the line, for what is said of it.

    Raises:
        InputError: a line without length, or one without points.
    """
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
    shorter where the line ends in it. Raises InputError: cells far too short."""
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
