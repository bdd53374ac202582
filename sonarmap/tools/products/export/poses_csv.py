# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""The pose of every scan as a table: docs/formats/output.md says what its columns are.

The first line names the columns and no comment stands before it: neither Excel nor QGIS nor Python's csv skips
comments. Units are in the names, the projected CRS and what heights count from in columns of their own.
"""

from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
from sonarmap.tools.files.writers.table import write_table
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.navigation import Navigation

_ERRORS = ("east", "north", "up", "rot_east", "rot_north", "rot_up")
_UPPER = tuple(combinations_with_replacement(range(6), 2))
_UNITS = ("m2", "m_rad", "rad2")  # of covariances, by how many of the two are turns
COVARIANCES = tuple(f"cov_{_ERRORS[i]}_{_ERRORS[j]}_{_UNITS[(i > 2) + (j > 2)]}" for i, j in _UPPER)
COLUMNS = (
    *("name", "scan", "utc", "unix_s", "lat_deg", "lon_deg", "easting_m", "northing_m", "depth_m", "height_m"),
    *("heave_m", "roll_deg", "pitch_deg", "heading_deg", "heading_grid_deg", "convergence_deg"),
    *("east_sigma_m", "north_sigma_m", "up_sigma_m", "roll_sigma_deg", "pitch_sigma_deg", "heading_sigma_deg"),
    *COVARIANCES,
    *("crs", "height_reference"),
)


def write_poses_csv(path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced) -> None:
    """Write one row per scan, in the order of the survey.

    Raises:
        InputError: the file cannot be written, or a place that the projection does not cover.
    """
    navigation = Navigation.of(earth)
    upper = navigation.covariances[:, [i for i, _ in _UPPER], [j for _, j in _UPPER]]
    rows: list[list[object]] = []
    for k, name in enumerate(navigation.names):
        stamp = repr(float(navigation.stamps[k])) if navigation.timed else ""
        numbers = [*_places(navigation, k), *_angles(navigation, k)]
        errors = [_error(number) for number in [*navigation.sigmas[k].tolist(), *upper[k].tolist()]]
        where = [earth.projection.name, navigation.vertical]
        rows.append([name, navigation.scans[k], navigation.utc[k], stamp, *numbers, *errors, *where])
    write_table(path, COLUMNS, rows)


def _places(navigation: Navigation, k: int) -> list[str]:
    """From latitude to heave: 1e-10 degrees are 0.01 mm."""
    latitude, longitude, height = navigation.geodetic[k].tolist()
    easting, northing, _ = navigation.projected[k].tolist()
    return [
        f"{latitude:z.10f}",
        f"{longitude:z.10f}",
        *(f"{x:z.5f}" for x in (easting, northing, -height, height, 0.0)),
    ]


def _angles(navigation: Navigation, k: int) -> list[str]:
    """From roll to the convergence; a heading of 359.9999999 is 0."""
    roll, pitch, true = navigation.attitudes[k].tolist()
    headings = (round(heading, 6) % 360.0 for heading in (true, float(navigation.grid_headings[k])))
    return [f"{angle:z.6f}" for angle in (roll, pitch, *headings, float(navigation.convergences[k]))]


def _error(number: float) -> str:
    return f"{number:z.9g}" if np.isfinite(number) else ""
