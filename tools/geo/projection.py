# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""A projected coordinate reference system for a map: every point is projected by itself.

Shifting the points of a map by the origin's easting and northing is not enough: grid North is not true North (2.6
degrees at 60 degrees north at the edge of a UTM zone, 22 m after 500 m), and the grid's scale is not 1.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kernels.errors import InputError
from tools.geo.georeference import Georeference

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

WGS84 = 4326
_NORTH, _SOUTH = 32600, 32700  # EPSG codes of UTM zone 0
_POLES = {True: 5041, False: 5042}  # UPS, easting first
_HIGHEST, _LOWEST = 84.0, -80.0  # latitudes that UTM covers [deg]
# What heights count from, as a vertical CRS of EPSG; the water's surface has none.
_VERTICAL_EPSG = {"MSL": 5714, "EGM96": 5773, "EGM2008": 3855}


@dataclass(frozen=True)  # without slots: the transformer is kept
class Projection:
    """The CRS of one map.

    Attributes:
        crs: horizontal, projected, with axes in meters.
        vertical: what heights count from: a name of `tools.geo.georeference.VERTICALS`.
    """

    crs: "CRS"
    vertical: str

    @classmethod
    def of(cls, georeference: Georeference, crs: str | None = None) -> "Projection":
        """The UTM zone of the map's origin (UPS near the poles), or the CRS of this name, such as EPSG:25832.

        Raises:
            InputError: no such CRS, or one that is not projected in meters.
        """
        from pyproj import CRS
        from pyproj.exceptions import CRSError

        if crs is None:
            return cls(CRS.from_epsg(utm_epsg(georeference.latitude, georeference.longitude)), georeference.vertical)
        try:
            wanted = CRS.from_user_input(crs)
        except CRSError as error:
            raise InputError(
                f"--crs is {crs!r}, which PROJ does not know ({error}); wanted one as EPSG:32632"
            ) from error
        units = {axis.unit_name for axis in wanted.axis_info}
        if not wanted.is_projected or units != {"metre"} or len(wanted.axis_info) != 2:
            raise InputError(
                f"--crs {crs} is {wanted.name}, {wanted.type_name} in {', '.join(sorted(units))}; wanted a projected "
                "one in meters without heights, as EPSG:32632"
            )
        return cls(wanted, georeference.vertical)

    @property
    def name(self) -> str:
        """As EPSG:32632, or in words where it has no code."""
        authority = self.crs.to_authority()
        return ":".join(authority) if authority else self.crs.name

    @cached_property
    def crs_with_heights(self) -> "CRS":
        """The same with the vertical reference, where that is one that EPSG knows."""
        from pyproj import CRS
        from pyproj.crs import CompoundCRS

        if self.vertical == "ellipsoid":
            return self.crs.to_3d()
        if self.vertical in _VERTICAL_EPSG:
            height = CRS.from_epsg(_VERTICAL_EPSG[self.vertical])
            return CompoundCRS(f"{self.crs.name} + {height.name}", [self.crs, height])
        return self.crs

    def project(self, geodetic: np.ndarray) -> np.ndarray:
        """(N, 3) float64 easting, northing, height [m] of (N, 3) latitude, longitude [deg], height [m].

        Raises:
            InputError: a place that this CRS does not cover.
        """
        latitude, longitude, height = np.asarray(geodetic, np.float64).T
        easting, northing = self._transformer.transform(longitude, latitude)
        projected = np.column_stack([easting, northing, height])
        if not np.isfinite(projected).all():
            raise InputError(f"{self.name} ({self.crs.name}) does not cover the map; choose another --crs")
        return projected

    def unproject(self, projected: np.ndarray) -> np.ndarray:
        """(N, 3) float64 latitude, longitude [deg], height [m] of (N, 3) easting, northing, height [m].

        Raises:
            InputError: numbers that are no place in this CRS.
        """
        easting, northing, height = np.asarray(projected, np.float64).T
        longitude, latitude = self._transformer.transform(easting, northing, direction="INVERSE")
        geodetic = np.column_stack([latitude, longitude, height])
        if not np.isfinite(geodetic).all():
            raise InputError(f"an easting or northing is no place in {self.name} ({self.crs.name})")
        return geodetic

    def convergence(self, geodetic: np.ndarray) -> np.ndarray:
        """(N,) float64 grid convergence [deg] at places (N, 3): a true bearing is the grid bearing plus this."""
        from pyproj import Proj

        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        return np.asarray(Proj(self.crs).get_factors(longitude, latitude).meridian_convergence, np.float64)

    def crosses_zone(self, geodetic: np.ndarray) -> bool:
        """Whether some of the places (N, 3) lie in another UTM zone than the map's."""
        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        corners = {
            utm_epsg(lat, lon)
            for lat in (float(latitude.min()), float(latitude.max()))
            for lon in (float(longitude.min()), float(longitude.max()))
        }
        return self.crs.utm_zone is not None and corners != {self.crs.to_epsg()}

    @cached_property
    def _transformer(self) -> "Transformer":
        from pyproj import CRS, Transformer

        # WGS84 and ETRS89 and the like are one up to a meter; a datum whose grid is missing is refused, not guessed
        return Transformer.from_crs(
            CRS.from_epsg(WGS84), self.crs, always_xy=True, allow_ballpark=False, only_best=True
        )


def utm_epsg(latitude: float, longitude: float) -> int:
    """The EPSG code of the UTM zone of a place [deg], or of UPS near the poles.

    The zones are those of the Defense Mapping Agency's TM 8358.2 (1989), with its exceptions for southwestern Norway
    and Svalbard.
    """
    if not _LOWEST <= latitude < _HIGHEST:
        return _POLES[latitude > 0]
    zone = int((longitude + 180) // 6) % 60 + 1
    if 56 <= latitude < 64 and 3 <= longitude < 12:
        zone = 32
    if latitude >= 72 and 0 <= longitude < 42:
        zone = 31 + 2 * int((longitude + 3) // 12)
    return (_NORTH if latitude >= 0 else _SOUTH) + zone
