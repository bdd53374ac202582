# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The largest part of a finished map with its heights, and the coordinates in which its user gives places."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import VERTICALS, Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart


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
        """With the points alone that so many scans saw. Raises InputError: there is none."""
        kept = self.part.columns["seen"] >= least
        if not kept.any():
            most = int(self.part.columns["seen"].max())
            raise InputError(
                f"no point of {self.path} was seen by {least} scans, at most by {most}; give a smaller --seen"
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
        """Whether instruments measured which way is up."""
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
