"""A synthetic dive with loops, and its coordinates computed without the code under test."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pyproj import CRS, Transformer
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Loop
from sonarmap.tools.products.export.georeferenced import Georeferenced
from tests.tools.products.export.finished import georeferenced, timed

# Name -> place of the map's origin, EPSG code of its UTM zone
PLACES = {
    "edge of a zone at 60 north": ((60.0, 11.9995), 32632),
    "180 east": ((-17.5, 179.9999), 32760),
    "70 south": ((-70.1, -68.3), 32719),
}
LOOPS = (Loop(0, 5, True, "ok"), Loop(1, 4, False, "contradicts"))
DOWN = -31.25  # z of the sensor [m]


def dive(place: str = "edge of a zone at 60 north", stamps: np.ndarray | None = None) -> Georeferenced:
    """Georeferenced dive of six scans, each 40 m east and 12 m north of the last, with different attitudes."""
    there, _ = PLACES[place]
    k = np.arange(6)
    shifts = np.column_stack([k * 40.0 - 90.0, k * 12.0 - 20.0, DOWN + 0.5 * k])
    # yaw counterclockwise from East, pitch nose down, roll starboard down
    R = Rotation.from_euler("ZYX", np.column_stack([60.0 - 25 * k, 7.0 - k, 2.0 * k - 3]), degrees=True)
    earth = georeferenced(Georeference(*there), RigidTransform.from_components(shifts, R))
    if stamps is not None:
        earth = timed(earth, stamps)
    return with_part(earth, earth.part, loops=LOOPS)


def with_part(earth: Georeferenced, part, **of_folder) -> Georeferenced:
    """The same map with another part and other fields of its folder."""
    folder = replace(earth.folder, parts=(part,), **of_folder)
    return Georeferenced(folder, part, earth.georeference, earth.projection)


def geodetic_by_hand(earth: Georeferenced) -> np.ndarray:
    """Latitudes, longitudes [deg], heights [m] (n, 3) by PROJ's azimuthal equidistant projection about the origin.

    It preserves distances and bearings from the origin, as the tangent plane does for a map of some 100 m; points
    31 m below the ellipsoid span an angle wider by 31 m over the Earth's radius (0.5 mm here).
    """
    here = earth.georeference
    aeqd = CRS.from_proj4(f"+proj=aeqd +lat_0={here.latitude} +lon_0={here.longitude} +ellps=WGS84 +units=m")
    x, y, z = earth.part.trajectory.T_world_sensor.translation.T
    wider = 1 - z / 6.371e6
    to_degrees = Transformer.from_crs(aeqd, 4326, always_xy=True)
    longitude, latitude = to_degrees.transform(x * wider, y * wider)
    return np.column_stack([latitude, longitude, z])


def projected_by_hand(geodetic: np.ndarray, epsg: int) -> np.ndarray:
    """Easting, northing (n, 2) [m] of latitudes, longitudes [deg]."""
    to_grid = Transformer.from_crs(4326, epsg, always_xy=True)
    return np.column_stack(to_grid.transform(geodetic[:, 1], geodetic[:, 0]))


def distances(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distances (n,) [m] along the ellipsoid between positions (n, 2+) of latitude, longitude [deg]."""
    from pyproj import Geod

    return np.asarray(Geod(ellps="WGS84").inv(places[:, 1], places[:, 0], others[:, 1], others[:, 0])[2])


def floats(rows: Sequence[dict[str, str]], *names: str) -> np.ndarray:
    """Numbers (n, k) of a table's columns."""
    return np.array([[float(row[name]) for name in names] for row in rows])
