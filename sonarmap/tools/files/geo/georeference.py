"""The frame of a map on the Earth.

x and y are East and North in the plane that touches the WGS84 ellipsoid at the origin; z is the height above the
vertical reference, which follows the Earth's curvature as depths below the water's surface do. (Straight up from that
plane a point 500 m away would be 2 cm higher, one 5 km away 2 m.)
"""

from dataclasses import asdict, dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from pyproj import Transformer

# What heights may count from. A height above a geoid keeps its number: nothing is converted, so no grid is needed.
VERTICALS = {
    "surface": "the water's surface during the survey",
    "MSL": "mean sea level",
    "ellipsoid": "the WGS84 ellipsoid",
    "EGM96": "the EGM96 geoid",
    "EGM2008": "the EGM2008 geoid",
}
DEFAULT_VERTICAL = "surface"
EAST = 90.0  # compass heading of an x axis that points East
_FARTHEST = 200e3  # from the origin [m]: beyond it a plane is no map of the Earth
_ROUNDS = 3  # of bringing a point to its height: each leaves a millionth of the error before


@dataclass(frozen=True, slots=True)
class Georeference:
    """Where the origin of a map is, and which way its x axis points.

    Attributes:
        latitude, longitude: of the origin [deg], WGS84.
        height: of the origin above the vertical reference [m].
        vertical: what heights count from: surface (the water's, during the survey), MSL, ellipsoid, EGM96 or EGM2008.
        heading: true compass heading of the map's x axis [deg]; 90 for East, as in every map that instruments place.

    Raises:
        InputError: a latitude beyond 89.9 or longitude beyond 180 degrees, another number that is not finite, an
            unknown vertical reference.
    """

    latitude: float
    longitude: float
    height: float = 0.0
    vertical: str = DEFAULT_VERTICAL
    heading: float = EAST

    def __post_init__(self) -> None:
        if not (abs(self.latitude) <= 89.9 and abs(self.longitude) <= 180):  # NaN is refused too
            raise InputError(
                f"the origin is {self.latitude}, {self.longitude}; wanted a latitude between -89.9 and 89.9 degrees "
                "and a longitude between -180 and 180, the latitude first"
            )
        if not (abs(self.height) <= 12_000 and np.isfinite(self.heading)):
            raise InputError(
                f"the origin has height {self.height} m and heading {self.heading}; wanted a height within 12 km and "
                "degrees"
            )
        if self.vertical not in VERTICALS:
            raise InputError(
                f"the vertical reference is {self.vertical!r}; wanted one of {', '.join(VERTICALS)}: what heights "
                "count from"
            )

    def geodetic(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) float64 latitude, longitude [deg] and height above the vertical reference [m] of points (N, 3) [m].
        Raises InputError: points more than 200 km from the origin."""
        points = np.asarray(points, np.float64)
        if points.size and not np.abs(points).max() <= _FARTHEST:
            raise InputError(
                f"points lie up to {np.abs(points).max() / 1000:.6g} km from the map's origin; wanted them within "
                f"{_FARTHEST / 1000:g} km"
            )
        x, y = self._turned(points[:, :2], EAST - self.heading).T
        height = self.height + points[:, 2]
        up = height.copy()
        latitude, longitude = np.zeros_like(x), np.zeros_like(x)
        for _ in range(_ROUNDS):
            longitude, latitude, reached = self._topocentric.transform(x, y, up, direction="INVERSE")
            up = up + height - reached
        return np.column_stack([latitude, longitude, height])

    def local(self, geodetic: np.ndarray) -> np.ndarray:
        """(N, 3) float64 points [m] of latitudes, longitudes [deg] and heights [m] (N, 3): the inverse of `geodetic`.
        Raises InputError: places more than 200 km from the origin."""
        latitude, longitude, height = np.asarray(geodetic, np.float64).T
        x, y, _ = self._topocentric.transform(longitude, latitude, height)
        flat = self._turned(np.column_stack([x, y]), self.heading - EAST)
        if flat.size and not np.abs(flat).max() <= _FARTHEST:
            raise InputError(
                f"a place is {np.abs(flat).max() / 1000:.6g} km from the map's origin at {self.latitude:.6f}, "
                f"{self.longitude:.6f}; wanted all within {_FARTHEST / 1000:g} km"
            )
        return np.column_stack([flat, height - self.height])

    def to_json(self) -> dict[str, Any]:
        """As summary.json has it; `of_json` reads it."""
        return asdict(self)

    @classmethod
    def of_json(cls, value: dict[str, Any]) -> "Georeference":
        """What `to_json` wrote."""
        try:
            return cls(**value)
        except TypeError as error:
            raise InputError(f"a georeference of {sorted(value)}: {error}; write the map again") from error

    @property
    def _topocentric(self) -> "Transformer":
        return _transformer(self.latitude, self.longitude)

    @staticmethod
    def _turned(flat: np.ndarray, degrees: float) -> np.ndarray:
        """(N, 2) turned counterclockwise."""
        if degrees == 0:
            return flat
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return flat @ np.array([[c, s], [-s, c]])


@cache
def _transformer(latitude: float, longitude: float) -> "Transformer":
    """From longitude, latitude and height to East, North and Up about a point of the ellipsoid."""
    from pyproj import Transformer

    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude!r} +lon_0={longitude!r} +h_0=0"
    )
