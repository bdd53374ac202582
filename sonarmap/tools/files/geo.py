"""Georeferencing: the frame of a map on the Earth, and projections to a CRS, computed with pyproj.

x and y are East and North in the plane that touches the WGS84 ellipsoid at the origin; z is the height above the
vertical reference, which follows the Earth's curvature. (Measured perpendicular to the tangent plane, a height would
differ by 2 cm at 500 m from the origin and by 2 m at 5 km.)

Every point is projected individually. Adding the origin's easting and northing to local coordinates is not enough:
grid North is not true North (2.6 degrees at 60 degrees north at the edge of a UTM zone, 22 m after 500 m), and the
grid's scale is not 1.
"""

from dataclasses import asdict, dataclass
from functools import cache, cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from pyproj import CRS, Transformer

# Vertical references. Heights are never converted between them, so no geoid grid is needed.
VERTICALS = {
    "surface": "the water's surface during the survey",
    "MSL": "mean sea level",
    "ellipsoid": "the WGS84 ellipsoid",
    "EGM96": "the EGM96 geoid",
    "EGM2008": "the EGM2008 geoid",
}
DEFAULT_VERTICAL, ELLIPSOID = "surface", "ellipsoid"
EAST = 90.0  # compass heading of an x axis that points East
_FARTHEST = 200e3  # largest distance from the origin at which a tangent plane still makes a map [m]
_ITERATIONS = 3  # iterations that find a point's height above the ellipsoid; each divides the error by a million
WGS84 = 4326
DEGREE = 111_195.0  # length of a degree of latitude on the mean sphere [m]
_NORTH, _SOUTH = 32600, 32700  # EPSG codes of UTM zone 0
_POLES = {True: 5041, False: 5042}  # UPS, easting first
_HIGHEST, _LOWEST = 84.0, -80.0  # latitudes that UTM covers [deg]
# EPSG code of the vertical CRS of each vertical reference; the water's surface has none.
_VERTICAL_EPSG = {"MSL": 5714, "EGM96": 5773, "EGM2008": 3855}
_ELLIPSOID_NAME = "Ellipsoid (metre)"
_ELLIPSOID_WKT = (
    f'VERT_CS["{_ELLIPSOID_NAME}",VERT_DATUM["Ellipsoid",2002],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Up",UP]]'
)
_UNKNOWN_WKT = (
    'VERT_CS["unknown",VERT_DATUM["unknown",2005],UNIT["metre",1,AUTHORITY["EPSG","9001"]],'
    'AXIS["Gravity-related height",UP]]'
)
_MARGIN = 10.0  # a CRS may be used this far outside its area of use [deg], as neighboring zones use a UTM zone
_WANTED = {"--origin": "as EPSG:32632:E,N, or degrees without a CRS, as 60.3913,5.3221"}  # option -> the wanted format
_NO_DATUM = (
    " without a datum, so its place on the Earth is unknown; wanted one with a datum, as EPSG:32632, or for export "
    "--crs map, the map's own frame"
)
_AREA = 0.01  # half width of the area around the map's origin in which a transformation must be valid [deg]


@dataclass(frozen=True, slots=True)
class Georeference:
    """The position of a map's origin on the Earth, and the heading of its x axis.

    Attributes:
        latitude, longitude: of the origin [deg], WGS84.
        height: of the origin above the vertical reference [m].
        vertical: reference of heights: surface (the water's, during the survey), MSL, ellipsoid, EGM96 or EGM2008.
        heading: true heading of the map's x axis [deg]; 90 (East) in every map that is georeferenced by instruments.

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
            raise InputError(f"the origin is {self.latitude}, {self.longitude}; wanted degrees within 89.9 and 180")
        if not (abs(self.height) <= 12_000 and np.isfinite(self.heading)):
            raise InputError(f"the origin has height {self.height} m, heading {self.heading}; wanted 12 km and degrees")
        if self.vertical not in VERTICALS:
            raise InputError(f"the vertical reference is {self.vertical!r}; wanted one of {', '.join(VERTICALS)}")

    def geodetic(self, points: np.ndarray) -> np.ndarray:
        """Geodetic coordinates (N, 3): latitude, longitude [deg], height above the vertical reference [m] of points.
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
        for _ in range(_ITERATIONS):
            longitude, latitude, reached = self._topocentric.transform(x, y, up, direction="INVERSE")
            up = up + height - reached
        return np.column_stack([latitude, longitude, height])

    def local(self, geodetic: np.ndarray) -> np.ndarray:
        """Map coordinates (N, 3) [m] of latitude, longitude [deg], height [m] (N, 3): the inverse of `geodetic`.
        Raises InputError: points more than 200 km from the origin."""
        latitude, longitude, height = np.asarray(geodetic, np.float64).T
        x, y, _ = self._topocentric.transform(longitude, latitude, height)
        flat = self._turned(np.column_stack([x, y]), self.heading - EAST)
        if flat.size and not np.abs(flat).max() <= _FARTHEST:
            raise InputError(
                f"a point is {np.abs(flat).max() / 1000:.6g} km from the map's origin at {self.latitude:.6f}, "
                f"{self.longitude:.6f}; wanted all within {_FARTHEST / 1000:g} km"
            )
        return np.column_stack([flat, height - self.height])

    def to_json(self) -> dict[str, Any]:
        """The georeference as summary.json stores it; `of_json` reads it back."""
        return asdict(self)

    @classmethod
    def of_json(cls, value: dict[str, Any]) -> "Georeference":
        """The georeference that `to_json` wrote."""
        try:
            return cls(**value)
        except TypeError as error:
            raise InputError(f"a georeference of {sorted(value)}: {error}; write the map again") from error

    @property
    def _topocentric(self) -> "Transformer":
        return _transformer(self.latitude, self.longitude)

    @staticmethod
    def _turned(flat: np.ndarray, degrees: float) -> np.ndarray:
        """Points (N, 2) rotated counterclockwise."""
        if degrees == 0:
            return flat
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return flat @ np.array([[c, s], [-s, c]])


@cache
def _transformer(latitude: float, longitude: float) -> "Transformer":
    """Transformer from longitude, latitude and height to East, North and Up about a point of the ellipsoid."""
    from pyproj import Transformer

    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude!r} +lon_0={longitude!r} +h_0=0"
    )


@dataclass(frozen=True)  # without slots, which cached_property needs
class Projection:
    """The projected CRS in which a map is exported or control points are given."""

    crs: "CRS"  # horizontal, projected, with axes in meters
    vertical: str  # vertical reference of heights: a name of VERTICALS

    @classmethod
    def of(cls, georeference: Georeference, crs: str | None = None, option: str = "--crs") -> "Projection":
        """The projection to `crs`, such as EPSG:25832, or by default to the UTM zone of the map's origin (UPS near the
        poles). `option` is named in errors. Raises InputError: an unknown CRS, or one not projected in meters."""
        from pyproj import CRS

        if crs is None:
            return cls(CRS.from_epsg(utm_epsg(georeference.latitude, georeference.longitude)), georeference.vertical)
        wanted = _projected(crs, option)
        _require_exact(wanted, f"{option} {crs}", georeference)
        return cls(wanted, georeference.vertical)

    @property
    def name(self) -> str:
        """The code of the CRS, as EPSG:32632, or its name if it has no code."""
        authority = self.crs.to_authority()
        return ":".join(authority) if authority else self.crs.name

    @cached_property
    def crs_with_heights(self) -> "CRS":
        """The CRS combined with the vertical reference, if EPSG has a code for that."""
        from pyproj import CRS
        from pyproj.crs import CompoundCRS

        if self.vertical == "ellipsoid":
            return self.crs.to_3d()
        if self.vertical_epsg is None:
            return self.crs
        height = CRS.from_epsg(self.vertical_epsg)
        return CompoundCRS(f"{self.crs.name} + {height.name}", [self.crs, height])

    @cached_property
    def old_wkt(self) -> str:
        """WKT 1 of `crs_with_heights`, which LAS 1.4 requires and every program reads."""
        from pyproj.enums import WktVersion

        if self.vertical != "ellipsoid":
            return self.crs_with_heights.to_wkt(WktVersion.WKT1_GDAL)
        # WKT 1 has no CRS of three dimensions; this is how GDAL and PROJ write and read one
        flat = self.crs.to_wkt(WktVersion.WKT1_GDAL)
        return f'COMPD_CS["{self.crs.name} + {_ELLIPSOID_NAME}",{flat},{_ELLIPSOID_WKT}]'

    @cached_property
    def vertical_wkt(self) -> str:
        """WKT 1 of the vertical reference alone; for the water's surface an unknown datum."""
        from pyproj import CRS
        from pyproj.enums import WktVersion

        if self.vertical_epsg is None:
            return _ELLIPSOID_WKT if self.vertical == "ellipsoid" else _UNKNOWN_WKT
        return CRS.from_epsg(self.vertical_epsg).to_wkt(WktVersion.WKT1_GDAL)

    @property
    def vertical_epsg(self) -> int | None:
        """EPSG code of the vertical CRS; None for the water's surface and the ellipsoid."""
        return _VERTICAL_EPSG.get(self.vertical)

    def project(self, geodetic: np.ndarray) -> np.ndarray:
        """Easting, northing, height (N, 3) float64 [m] of latitude, longitude [deg], height [m] (N, 3). Raises
        InputError: a point that this CRS does not cover."""
        latitude, longitude, height = np.asarray(geodetic, np.float64).T
        easting, northing = self._transformer.transform(longitude, latitude)
        projected = np.column_stack([easting, northing, height])
        if not np.isfinite(projected).all():
            raise InputError(f"{self.name} ({self.crs.name}) does not cover the map; choose another --crs")
        return projected

    def unproject(self, projected: np.ndarray) -> np.ndarray:
        """Latitude, longitude [deg], height [m] (N, 3) float64 of easting, northing, height [m] (N, 3). Raises
        InputError: coordinates outside of this CRS."""
        easting, northing, height = np.asarray(projected, np.float64).T
        longitude, latitude = self._transformer.transform(easting, northing, direction="INVERSE")
        geodetic = np.column_stack([latitude, longitude, height])
        if not np.isfinite(geodetic).all():
            raise InputError(f"an easting or northing is outside of {self.name} ({self.crs.name})")
        return geodetic

    def convergence(self, geodetic: np.ndarray) -> np.ndarray:
        """Grid convergence (N,) float64 [deg] at geodetic points (N, 3): true bearing minus grid bearing."""
        from pyproj import Proj

        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        return np.asarray(Proj(self.crs).get_factors(longitude, latitude).meridian_convergence, np.float64)

    def crosses_zone(self, geodetic: np.ndarray) -> bool:
        """Whether any of the geodetic points (N, 3) lies outside of the UTM zone of this CRS."""
        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        ends = ([float(x.min()), float(x.max())] for x in (latitude, longitude))
        corners = {utm_epsg(*corner) for corner in product(*ends)}
        # zone names instead of EPSG codes, so that any datum compares equal: EPSG:25832 is zone 32N too
        zones = {f"{epsg % 100}{'N' if epsg < _SOUTH else 'S'}" for epsg in corners}
        return self.crs.utm_zone is not None and zones != {self.crs.utm_zone}

    def covers(self, geodetic: np.ndarray, margin: float = 0.0) -> bool:
        """Whether all geodetic points (N, 3) lie in the CRS's area of use, enlarged by a margin [deg]."""
        area = self.crs.area_of_use
        if area is None or not np.isfinite(geodetic).all():
            return area is None
        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        eastward = (longitude - area.west + margin) % 360 <= (area.east - area.west) % 360 + 2 * margin
        whole = area.east - area.west >= 360
        within = (latitude >= area.south - margin) & (latitude <= area.north + margin)
        return bool((within & (whole | eastward)).all())

    @cached_property
    def _transformer(self) -> "Transformer":
        from pyproj import CRS, Transformer

        # WGS84, ETRS89 and the like agree within a meter; a datum shift whose grid is missing is refused, not guessed
        return Transformer.from_crs(
            CRS.from_epsg(WGS84), self.crs, always_xy=True, allow_ballpark=False, only_best=True
        )


def on_the_earth(projected: "ArrayLike", crs: str | None, option: str) -> np.ndarray:
    """Latitude, longitude [deg], height [m] (n, 3) of easting, northing, height [m] (n, 3) in a CRS as EPSG:32632
    that `option` gave. Raises InputError: see `Projection.of`; the first point is outside of its area."""
    from pyproj import Transformer

    projected, rough = np.asarray(projected), Projection(_projected(crs or "", option), DEFAULT_VERTICAL)
    to_degrees = Transformer.from_crs(rough.crs, WGS84, always_xy=True)  # up to 200 m wrong if a grid is missing
    first = projected[0, [[0, 1], [1, 0]]]  # as given, and with easting and northing exchanged
    longitude, latitude = to_degrees.transform(*first.T)
    place, exchanged = np.column_stack([latitude, longitude, [0.0] * 2])[:, None]
    beyond = not rough.covers(place, _MARGIN) or (not rough.covers(place) and rough.covers(exchanged))
    if beyond or not np.isfinite(place).all():
        raise InputError(
            f"{option} {crs}: easting {first[0, 0]:.12g}, northing {first[0, 1]:.12g} is not in the area of "
            f"{rough.crs.name}; check the CRS and the numbers (easting first)"
        )
    return Projection.of(Georeference(*place[0, :2].tolist()), crs, option).unproject(projected)


def _projected(crs: str, option: str) -> "CRS":
    """The projected CRS called `crs`. Raises InputError: see `Projection.of`."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    wanted = _WANTED.get(option, "as EPSG:32632")
    try:
        named = CRS.from_user_input(crs)
    except CRSError as error:
        raise InputError(f"{option} {crs}: PROJ does not know this CRS ({error}); wanted a CRS {wanted}") from error
    if named.is_engineering:
        raise InputError(f"{option} {crs} is {named.name}, a local CRS{_NO_DATUM}")
    units = {axis.unit_name for axis in named.axis_info}
    westward = any(axis.direction == "west" for axis in named.axis_info)
    if not named.is_projected or units != {"metre"} or len(named.axis_info) != 2 or westward:
        raise InputError(
            f"{option} {crs} is {named.name}; wanted a projected one in meters, East and North, no heights, {wanted}"
        )
    return named


def _require_exact(crs: "CRS", given: str, georeference: Georeference) -> None:
    """Raise InputError if the best transformation from WGS84 to the CRS needs a grid that is not installed: the next
    best is off by meters."""
    import warnings

    from pyproj.transformer import AreaOfInterest, TransformerGroup

    latitude, longitude = georeference.latitude, georeference.longitude
    about = AreaOfInterest(longitude - _AREA, latitude - _AREA, longitude + _AREA, latitude + _AREA)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about a missing grid, which is reported below
        group = TransformerGroup(WGS84, crs, always_xy=True, allow_ballpark=False, area_of_interest=about)
    if group.best_available and group.transformers:
        return
    if not group.transformers:
        if crs.datum is None or crs.datum.name.lower().startswith("unknown"):
            raise InputError(f"{given} ({crs.name}) is a projected CRS{_NO_DATUM}")
        raise InputError(f"{given} ({crs.name}) has no known relation to WGS84 at {latitude:.4f}, {longitude:.4f}")
    grids = {grid.short_name for best in group.unavailable_operations[:1] for grid in best.grids if not grid.available}
    raise InputError(
        f"{given} ({crs.name}) needs PROJ's grid {', '.join(sorted(grids))}; get it by `pyproj sync --file NAME`"
    )


def utm_epsg(latitude: float, longitude: float) -> int:
    """EPSG code of the UTM zone at a latitude and longitude [deg], or of UPS near the poles. Zones as in the Defense
    Mapping Agency's TM 8358.2 (1989), with its exceptions for southwestern Norway and Svalbard."""
    if not _LOWEST <= latitude < _HIGHEST:
        return _POLES[latitude > 0]
    zone = int((longitude + 180) // 6) % 60 + 1
    if 56 <= latitude < 64 and 3 <= longitude < 12:
        zone = 32
    if latitude >= 72 and 0 <= longitude < 42:
        zone = 31 + 2 * int((longitude + 3) // 12)
    return (_NORTH if latitude >= 0 else _SOUTH) + zone
