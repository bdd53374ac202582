# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""What stands beside every exported file: map.laz.json says what map.laz is, and what it was made from."""

from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.geo.georeference import EAST, VERTICALS
from sonarmap.tools.files.inputs import package_versions, sha256_of
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.time_scales import are_times, utc_text
from sonarmap.tools.products.export.formats import FORMATS
from sonarmap.tools.products.export.georeferenced import Georeferenced

_LIBRARIES = ("pyproj", "laspy", "lazrs", "rasterio", "pye57")
_FRAMES = {
    "projected": "easting, northing and height; every point is projected by itself",
    "geographic": "longitude, latitude and height",
}


def side_car_content(
    written: Path, name: str, format_name: str, folder: Map, part: MapPart, earth: Georeferenced | None
) -> dict[str, Any]:
    """Provenance, frame, datum, units and signs of one exported file, which is `written` now and will be `name`; its
    `details` are for the caller to fill in."""
    kind = FORMATS[format_name]
    coordinates = "map" if earth is None else kind.coordinates
    return {
        "file": name,
        "format": format_name,
        "what": kind.words,
        "bytes": written.stat().st_size,
        "sha256": sha256_of(written),
        "written_by": package_versions(*_LIBRARIES),
        "frame": _frame(coordinates, part),
        **_place(coordinates, earth),
        "units": "m, s; degrees where a name says so, and for latitude and longitude",
        "signs": "height and z are positive up, a depth is positive down: depth_m = -height_m",
        "points": len(part.points),
        "scans": len(part.scans),
        "voxel_m": folder.voxel,
        "taken": _taken(part.trajectory.stamps),
        "details": {},
        "inputs": folder.summary.get("inputs", []),
        "map": {
            "part": f"{[each.suffix for each in folder.parts].index(part.suffix) + 1} of {len(folder.parts)}",
            "written_by": folder.summary.get("versions"),
            "settings": folder.summary.get("settings"),
        },
    }


def _frame(coordinates: str, part: MapPart) -> str:
    if coordinates in _FRAMES:
        return _FRAMES[coordinates]
    if part.placed:
        return "the map's: x East, y North, z up, from its origin"
    if part.in_world:
        return f"the map's: x East, y North, z up, but for what was not measured: {', '.join(part.unmeasured)}"
    return f"the map's: that of its first scan's sensor, x forward, y left, z up ({part.suffix or 'the largest part'})"


def _place(coordinates: str, earth: Georeferenced | None) -> dict[str, Any]:
    """The reference system of the file's numbers, and the map's origin in WGS84."""
    if earth is None:
        return dict.fromkeys(("datum", "crs", "vertical_reference", "vertical_epsg", "origin"))
    from pyproj import CRS

    from sonarmap.tools.files.geo.projection import WGS84

    here, crs = earth.georeference, earth.projection.crs_with_heights
    rows: dict[str, Any] = {"datum": "WGS84", "crs": None}
    if coordinates == "projected":
        datum = earth.projection.crs.datum
        rows = {
            "datum": None if datum is None else datum.name,
            "crs": {"name": crs.name, "epsg": earth.projection.crs.to_epsg(), "wkt": crs.to_wkt()},
        }
    elif coordinates == "geographic":
        geographic = CRS.from_epsg(WGS84)
        rows["crs"] = {"name": geographic.name, "epsg": WGS84, "wkt": geographic.to_wkt()}
    convergence = float(earth.projection.convergence(here.geodetic(np.zeros((1, 3))))[0])
    return {
        **rows,
        "vertical_reference": f"heights count from {VERTICALS[here.vertical]}",
        "vertical_epsg": earth.projection.vertical_epsg,
        "origin": {
            "latitude_deg": here.latitude,
            "longitude_deg": here.longitude,
            "height_m": here.height,
            "x_axis_true_heading_deg": here.heading % 360,
            "x_axis_grid_heading_deg": (here.heading - convergence) % 360,
            "grid_convergence_deg": convergence,
            "is": f"the zero of the map's frame; its y axis points to {(here.heading - EAST) % 360:g} degrees",
        },
    }


def _taken(stamps: np.ndarray) -> dict[str, Any]:
    """When the scans were taken."""
    if not are_times(stamps):
        return {"utc": None, "stamps_s": [float(stamps.min()), float(stamps.max())]}
    return {"utc": [utc_text(float(stamps.min())), utc_text(float(stamps.max()))]}
