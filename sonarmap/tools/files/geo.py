"""The frame of a map on the Earth, and its projections; pyproj computes.

x and y are East and North in the plane that touches the WGS84 ellipsoid at the origin; z is the height above the
vertical reference, which follows the Earth's curvature as depths below the water's surface do. (Straight up from that
plane a point 500 m away would be 2 cm higher, one 5 km away 2 m.)

Every point is projected by itself: shifting the points of a map by the origin's easting and northing is not enough, as
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
WGS84 = 4326
_NORTH, _SOUTH = 32600, 32700  # EPSG codes of UTM zone 0
_POLES = {True: 5041, False: 5042}  # UPS, easting first
_HIGHEST, _LOWEST = 84.0, -80.0  # latitudes that UTM covers [deg]
# What heights count from, as a vertical CRS of EPSG; the water's surface has none.
_VERTICAL_EPSG = {"MSL": 5714, "EGM96": 5773, "EGM2008": 3855}
_ELLIPSOID_NAME = "Ellipsoid (metre)"
_ELLIPSOID_WKT = (
    f'VERT_CS["{_ELLIPSOID_NAME}",VERT_DATUM["Ellipsoid",2002],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Up",UP]]'
)
_MARGIN = 10.0  # degrees beyond its area up to which a CRS is used, as a zone is by its neighbors
_AS = {"--origin": "as EPSG:32632:E,N, or degrees without a CRS, as 60.3913,5.3221"}  # by option, what is wanted
_NO_DATUM = (
    " without a datum: nothing says where on the Earth it lies; wanted one with a datum, as EPSG:32632, or for export "
    "--crs map, the map's own frame"
)
_ABOUT = 0.01  # degrees about a map's origin, where a transformation is looked for


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


@dataclass(frozen=True)  # without slots: the transformer is kept
class Projection:
    """The CRS of one map."""

    crs: "CRS"  # horizontal, projected, with axes in meters
    vertical: str  # what heights count from: a name of VERTICALS

    @classmethod
    def of(cls, georeference: Georeference, crs: str | None = None, option: str = "--crs") -> "Projection":
        """The UTM zone of the map's origin (UPS near the poles), or the CRS of this name, such as EPSG:25832, which the
        user gave with this option. Raises InputError: no such CRS, or one that is not projected in meters."""
        from pyproj import CRS

        if crs is None:
            return cls(CRS.from_epsg(utm_epsg(georeference.latitude, georeference.longitude)), georeference.vertical)
        wanted = _projected(crs, option)
        _require_exact(wanted, f"{option} {crs}", georeference)
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
        if self.vertical_epsg is None:
            return self.crs
        height = CRS.from_epsg(self.vertical_epsg)
        return CompoundCRS(f"{self.crs.name} + {height.name}", [self.crs, height])

    @cached_property
    def old_wkt(self) -> str:
        """WKT 1 of `crs_with_heights`, as LAS 1.4 wants it and every program reads it."""
        from pyproj.enums import WktVersion

        if self.vertical != "ellipsoid":
            return self.crs_with_heights.to_wkt(WktVersion.WKT1_GDAL)
        # WKT 1 has no CRS of three dimensions; this is how GDAL and PROJ write and read one
        flat = self.crs.to_wkt(WktVersion.WKT1_GDAL)
        return f'COMPD_CS["{self.crs.name} + {_ELLIPSOID_NAME}",{flat},{_ELLIPSOID_WKT}]'

    @property
    def vertical_epsg(self) -> int | None:
        """Of the heights' CRS; None for the water's surface, which has none, and the ellipsoid, which needs none."""
        return _VERTICAL_EPSG.get(self.vertical)

    def project(self, geodetic: np.ndarray) -> np.ndarray:
        """(N, 3) float64 easting, northing, height [m] of (N, 3) latitude, longitude [deg], height [m]. Raises
        InputError: a place that this CRS does not cover."""
        latitude, longitude, height = np.asarray(geodetic, np.float64).T
        easting, northing = self._transformer.transform(longitude, latitude)
        projected = np.column_stack([easting, northing, height])
        if not np.isfinite(projected).all():
            raise InputError(f"{self.name} ({self.crs.name}) does not cover the map; choose another --crs")
        return projected

    def unproject(self, projected: np.ndarray) -> np.ndarray:
        """(N, 3) float64 latitude, longitude [deg], height [m] of (N, 3) easting, northing, height [m]. Raises
        InputError: numbers that are no place in this CRS."""
        easting, northing, height = np.asarray(projected, np.float64).T
        longitude, latitude = self._transformer.transform(easting, northing, direction="INVERSE")
        geodetic = np.column_stack([latitude, longitude, height])
        if not np.isfinite(geodetic).all():
            raise InputError(f"an easting or northing is not a place in {self.name} ({self.crs.name})")
        return geodetic

    def convergence(self, geodetic: np.ndarray) -> np.ndarray:
        """(N,) float64 grid convergence [deg] at places (N, 3): a true bearing is the grid bearing plus this."""
        from pyproj import Proj

        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        return np.asarray(Proj(self.crs).get_factors(longitude, latitude).meridian_convergence, np.float64)

    def crosses_zone(self, geodetic: np.ndarray) -> bool:
        """Whether some of the places (N, 3) lie in another UTM zone than the map's."""
        latitude, longitude, _ = np.asarray(geodetic, np.float64).T
        ends = ([float(x.min()), float(x.max())] for x in (latitude, longitude))
        corners = {utm_epsg(*corner) for corner in product(*ends)}
        # of any datum: EPSG:25832 is zone 32N too
        zones = {f"{epsg % 100}{'N' if epsg < _SOUTH else 'S'}" for epsg in corners}
        return self.crs.utm_zone is not None and zones != {self.crs.utm_zone}

    def covers(self, geodetic: np.ndarray, margin: float = 0.0) -> bool:
        """Whether all places (N, 3) lie in the area for which this CRS was made, grown by a margin [deg]."""
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

        # WGS84 and ETRS89 and the like are one up to a meter; a datum whose grid is missing is refused, not guessed
        return Transformer.from_crs(
            CRS.from_epsg(WGS84), self.crs, always_xy=True, allow_ballpark=False, only_best=True
        )


def on_the_earth(projected: "ArrayLike", crs: str | None, option: str) -> np.ndarray:
    """(n, 3) latitude, longitude [deg] and height [m] of (n, 3) easting, northing, height [m] in a CRS as EPSG:32632,
    which the user gave with this option. Raises InputError: see `Projection.of`; the first place is not in its area."""
    from pyproj import Transformer

    projected, rough = np.asarray(projected), Projection(_projected(crs or "", option), DEFAULT_VERTICAL)
    to_degrees = Transformer.from_crs(rough.crs, WGS84, always_xy=True)  # 200 m wrong where a grid is missing
    first = projected[0, [[0, 1], [1, 0]]]  # as given, and with easting and northing exchanged
    longitude, latitude = to_degrees.transform(*first.T)
    place, exchanged = np.column_stack([latitude, longitude, [0.0] * 2])[:, None]
    beyond = not rough.covers(place, _MARGIN) or (not rough.covers(place) and rough.covers(exchanged))
    if beyond or not np.isfinite(place).all():
        raise InputError(
            f"{option} {crs}: easting {first[0, 0]:.12g}, northing {first[0, 1]:.12g} is not in the area of "
            f"{rough.crs.name}; check the CRS and the numbers, of which the easting is the first"
        )
    return Projection.of(Georeference(*place[0, :2].tolist()), crs, option).unproject(projected)


def _projected(crs: str, option: str) -> "CRS":
    """The CRS of this name. Raises InputError: see `Projection.of`."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    wanted = _AS.get(option, "as EPSG:32632")
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
            f"{option} {crs} is {named.name}, {named.type_name} in {', '.join(sorted(units))}"
            f"{' to the West' if westward else ''}; wanted a projected one in meters to the East and North, "
            f"without heights, {wanted}"
        )
    return named


def _require_exact(crs: "CRS", given: str, georeference: Georeference) -> None:
    """Refuse a CRS whose best transformation from WGS84 needs a grid that is not installed: the next best is off by
    meters. Raises InputError: naming the grid."""
    import warnings

    from pyproj.transformer import AreaOfInterest, TransformerGroup

    latitude, longitude = georeference.latitude, georeference.longitude
    about = AreaOfInterest(longitude - _ABOUT, latitude - _ABOUT, longitude + _ABOUT, latitude + _ABOUT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the grid: it is said below
        group = TransformerGroup(WGS84, crs, always_xy=True, allow_ballpark=False, area_of_interest=about)
    if group.best_available and group.transformers:
        return
    if not group.transformers:
        if crs.datum is None or crs.datum.name.lower().startswith("unknown"):
            raise InputError(f"{given} ({crs.name}) is a projected CRS{_NO_DATUM}")
        raise InputError(
            f"{given} ({crs.name}) has no known relation to WGS84 at {latitude:.4f}, {longitude:.4f}, where the "
            "map would be; check the coordinates, or choose another"
        )
    grids = {grid.short_name for way in group.unavailable_operations[:1] for grid in way.grids if not grid.available}
    raise InputError(
        f"{given} ({crs.name}) needs PROJ's grid {', '.join(sorted(grids))}, which is not installed; wanted a CRS that "
        "follows from WGS84 without one, as the UTM zone, or install the grid with `pyproj sync --file NAME`"
    )


def utm_epsg(latitude: float, longitude: float) -> int:
    """The EPSG code of the UTM zone of a place [deg], or of UPS near the poles. The zones are those of the Defense
    Mapping Agency's TM 8358.2 (1989), with its exceptions for southwestern Norway and Svalbard."""
    if not _LOWEST <= latitude < _HIGHEST:
        return _POLES[latitude > 0]
    zone = int((longitude + 180) // 6) % 60 + 1
    if 56 <= latitude < 64 and 3 <= longitude < 12:
        zone = 32
    if latitude >= 72 and 0 <= longitude < 42:
        zone = 31 + 2 * int((longitude + 3) // 12)
    return (_NORTH if latitude >= 0 else _SOUTH) + zone
