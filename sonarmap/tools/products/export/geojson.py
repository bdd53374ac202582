# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""Track, scans and loops as GeoJSON (RFC 7946): longitude, latitude [deg, WGS84] and height [m]."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.writers.json_text import write_json
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.track_features import Feature, features_of


def write_geojson(path: Path, earth: Georeferenced) -> None:
    """Write a FeatureCollection; the property `layer` of a feature is track, scans or loops.

    A line across the 180th meridian is cut there (RFC 7946, section 3.1.9). Heights count from the property
    `height_reference`, which the RFC wants to be the WGS84 ellipsoid.
    """
    features = [_feature(each, earth.poses[each.scans][:, [1, 0, 2]]) for each in features_of(earth)]
    write_json(path, {"type": "FeatureCollection", "features": features})


def _feature(feature: Feature, places: np.ndarray) -> dict[str, Any]:
    """A feature through places (k, 3) of longitude, latitude, height."""
    pieces = [_rounded(piece) for piece in cut_at_180(places)]
    if len(places) == 1:
        geometry = {"type": "Point", "coordinates": pieces[0][0]}
    elif len(pieces) == 1:
        geometry = {"type": "LineString", "coordinates": pieces[0]}
    else:
        geometry = {"type": "MultiLineString", "coordinates": pieces}
    return {"type": "Feature", "geometry": geometry, "properties": {"layer": feature.layer} | feature.attributes}


def cut_at_180(line: np.ndarray) -> list[np.ndarray]:
    """The pieces (k, 3) of a line (n, 3) of longitude, latitude, height, each on one side of the 180th meridian."""
    pieces: list[np.ndarray] = []
    start: list[np.ndarray] = []
    for here, there in pairwise(line):
        start.append(here)
        step = there[0] - here[0]
        if abs(step) <= 180:
            continue
        side = np.copysign(180.0, here[0])
        rest = step + 2 * side  # 0 where both ends are the meridian itself, by its two names
        share = (side - here[0]) / rest if rest else 0.0
        border = here + share * (there - here)
        pieces.append(np.array([*start, [side, *border[1:]]]))
        start = [np.array([-side, *border[1:]])]
    pieces.append(np.array([*start, line[-1]]))
    return pieces


def _rounded(places: np.ndarray) -> list[list[float]]:
    """1e-10 degrees are 0.01 mm."""
    return [[round(x, 10), round(y, 10), round(z, 5)] for x, y, z in places.tolist()]
