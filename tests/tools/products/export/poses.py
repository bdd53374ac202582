"""A synthetic dive with loops, at places where conversions differ."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
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


def floats(rows: Sequence[dict[str, str]], *names: str) -> np.ndarray:
    """Numbers (n, k) of a table's columns."""
    return np.array([[float(row[name]) for name in names] for row in rows])
