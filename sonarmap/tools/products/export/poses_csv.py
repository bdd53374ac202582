# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The pose of every scan as a table: docs/formats/output.md says what its columns are.

The first line names the columns and no comment stands before it: neither Excel nor QGIS nor Python's csv skips
comments. Units are in the names, the projected CRS and what heights count from in columns of their own.
"""

from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from sonarmap.tools.files.writers.table import write_table
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.track_features import ANGLES, SIGMAS

_ERRORS = ("east", "north", "up", "rot_east", "rot_north", "rot_up")
_UPPER = tuple(combinations_with_replacement(range(6), 2))
_UNITS = ("m2", "m_rad", "rad2")  # of covariances, by how many of the two are turns
COVARIANCES = tuple(f"cov_{_ERRORS[i]}_{_ERRORS[j]}_{_UNITS[(i > 2) + (j > 2)]}" for i, j in _UPPER)
COLUMNS = (
    *("name", "scan", "utc", "unix_s", "lat_deg", "lon_deg", "easting_m", "northing_m", "depth_m", "height_m"),
    *("heave_m", *ANGLES, "heading_grid_deg", "convergence_deg", *SIGMAS),
    *COVARIANCES,
    *("crs", "height_reference"),
)


def write_poses_csv(path: Path, earth: Georeferenced) -> None:
    """Write one row per scan, in the order of the survey.

    Raises:
        InputError: the file cannot be written, or a place that the projection does not cover.
    """
    upper = earth.covariances[:, [i for i, _ in _UPPER], [j for _, j in _UPPER]]
    rows: list[list[str | int]] = []
    for k, name in enumerate(earth.names):
        stamp = repr(float(earth.stamps[k])) if earth.timed else ""
        errors = [f"{number:z.9g}" if np.isfinite(number) else "" for number in (*earth.sigmas[k], *upper[k])]
        where = [earth.projection.name, earth.georeference.vertical]
        row = [name, earth.part.scans[k], earth.utc[k], stamp, *_places(earth, k), *_angles(earth, k), *errors, *where]
        rows.append(row)
    write_table(path, COLUMNS, rows)


def _places(earth: Georeferenced, k: int) -> list[str]:
    """From latitude to heave: 1e-10 degrees are 0.01 mm."""
    *degrees, height = earth.poses[k].tolist()
    lengths = [*earth.projected_poses[k, :2].tolist(), -height, height, 0.0]
    return [*(f"{angle:z.10f}" for angle in degrees), *(f"{length:z.5f}" for length in lengths)]


def _angles(earth: Georeferenced, k: int) -> list[str]:
    """From roll to the convergence; a heading of 359.9999999 is 0."""
    roll, pitch, true = earth.attitudes[k].tolist()
    headings = (round(heading, 6) % 360.0 for heading in (true, float(earth.grid_headings[k])))
    return [f"{angle:z.6f}" for angle in (roll, pitch, *headings, float(earth.convergences[k]))]
