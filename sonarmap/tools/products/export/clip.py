# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""--clip: the area of a map that is exported, a box or the polygons of a file."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.readers.json_file import read_json

MAP_FRAME = "map"  # as --crs names the map's own coordinates
_DEGREES = np.array([180.0, 90.0])  # a box within these on the Earth is one of longitudes and latitudes
_WANTED = "a box W,S,E,N, or a GeoJSON file of polygons"


@dataclass(frozen=True, slots=True)
class Clip:
    """An area, seen from above."""

    polygons: tuple[tuple[np.ndarray, ...], ...]  # rings (k, 2) of each, of which inner ones are holes
    georeference: Georeference | None = None  # of the map's frame; None where the rings are in this
    projection: Projection | None = None  # whose easting and northing they are; None for longitude and latitude [deg]

    def inside(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool of points (N, 3) in the map's frame."""
        from matplotlib.path import Path as Ring

        places = self._places(points)
        inside = np.zeros(len(points), bool)
        for rings in self.polygons:
            crossed = np.zeros(len(points), bool)
            for ring in rings:
                crossed ^= Ring(self._unwound(ring)).contains_points(places)
            inside |= crossed
        return inside

    def _places(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) of points, as the rings have them."""
        if self.georeference is None:
            return points[:, :2]
        geodetic = self.georeference.geodetic(points)
        if self.projection is not None:
            return self.projection.project(geodetic)[:, :2]
        return self._unwound(geodetic[:, [1, 0]])

    def _unwound(self, places: np.ndarray) -> np.ndarray:
        """Longitudes without their jump at 180 degrees."""
        if self.georeference is None or self.projection is not None:
            return places
        middle = self.georeference.longitude
        return np.column_stack([middle + (places[:, 0] - middle + 180) % 360 - 180, places[:, 1]])


def read_clip(text: str, georeference: Georeference | None, crs: str | None) -> Clip:
    """The area that --clip names: GeoJSON is in longitude and latitude, a box in these or in the coordinates of --crs.

    Args:
        text: W,S,E,N, or the name of a file.
        georeference: of the map's frame, in which both are without one.
        crs: MAP_FRAME, or as `Projection.of` takes it.

    Raises:
        InputError: neither a box nor such a file.
    """
    try:
        box = np.array([float(number) for number in text.split(",")])
    except ValueError:
        return Clip(tuple(_read_polygons(Path(text))), georeference)
    if box.shape != (4,) or not np.isfinite(box).all() or not (box[:2] < box[2:]).all():
        raise InputError(f"--clip is {text!r}; wanted {_WANTED}, with W below E and S below N")
    west, south, east, north = box
    ring = np.array([[west, south], [east, south], [east, north], [west, north], [west, south]])
    if georeference is None or crs == MAP_FRAME:
        return Clip(((ring,),))
    in_degrees = bool((np.abs(ring) <= _DEGREES).all())
    return Clip(((ring,),), georeference, None if in_degrees else Projection.of(georeference, crs))


def _read_polygons(path: Path) -> list[tuple[np.ndarray, ...]]:
    content = read_json(path, _WANTED)
    try:
        old: dict[str, Any] = content.get("crs") or {"properties": {"name": "CRS84"}}  # of GeoJSON before RFC 7946
        crs = str(old["properties"]["name"])
        polygons = [tuple(np.array([xy[:2] for xy in ring], np.float64) for ring in rings) for rings in _rings(content)]
        usable = polygons and all(len(ring) > 3 and np.isfinite(ring).all() for rings in polygons for ring in rings)
    except (ValueError, LookupError, TypeError, AttributeError):
        crs, usable, polygons = "CRS84", False, []
    if not crs.endswith(("CRS84", "4326")):
        raise InputError(f"{path} is in {crs}; save it as GeoJSON in WGS 84 (EPSG:4326), as RFC 7946 has it")
    if not usable:
        raise InputError(f"{path} holds no polygon that can be used; wanted {_WANTED}")
    return polygons


def _rings(content: Any) -> Iterator[Any]:
    """The rings of every polygon of a GeoJSON object."""
    members: list[Any] = content.get("features") or content.get("geometries") or []
    for each in members:
        yield from _rings(each)
    if content["type"] == "Feature" and content["geometry"] is not None:
        yield from _rings(content["geometry"])
    elif content["type"] == "Polygon":
        yield content["coordinates"]
    elif content["type"] == "MultiPolygon":
        yield from content["coordinates"]
