# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""Files of rows: poses.csv, EIVA NaviEdit's two, graph.csv (docs/formats/output.md has their columns).

EIVA's layout is that of its support page "Merge format", the formats "NavLab" for position and for attitude, without a
line of names: https://eiva.freshdesk.com/support/solutions/articles/43000529417.
"""

from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.map_folder.names import GRAPH
from sonarmap.tools.files.time_scales import utc_texts
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.writers.atomic import atomic_path
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
GRAPH_COLUMNS = ("vertex", "name", "stamp", "utc", "map", "frame")


def write_poses_csv(path: Path, earth: Georeferenced) -> None:
    """Write one row per scan, in the order of the survey, under COLUMNS, with no comment above them: neither Excel nor
    QGIS nor Python's csv skips comments.

    Raises InputError: the file cannot be written, or a place that the projection does not cover."""
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


def write_eiva_position(path: Path, earth: Georeferenced) -> None:
    """Write Unix time [s], latitude, longitude [rad], WGS84, and depth [m], positive down, ascending in time."""
    places = np.column_stack([np.radians(earth.poses[:, :2]), -earth.poses[:, 2]])
    _write_eiva(path, earth, places, "{:z.14f} {:z.14f} {:z.5f}")


def write_eiva_attitude(path: Path, earth: Georeferenced) -> None:
    """Write Unix time [s], roll (starboard down), pitch (nose up) and true heading [rad], ascending in time."""
    _write_eiva(path, earth, np.radians(earth.attitudes), "{:z.10f} {:z.10f} {:z.10f}")


def _write_eiva(path: Path, earth: Georeferenced, rows: np.ndarray, form: str) -> None:
    with atomic_path(path) as temporary:
        lines = (f"{float(earth.stamps[k]):.6f} {form.format(*rows[k].tolist())}\n" for k in earth.in_time)
        temporary.write_text("".join(lines))


def write_graph(path: Path, folder: Map, part: MapPart, earth: Georeferenced | None) -> None:
    """Write name, time and frame of every vertex, for which g2o has no place, to `path`, and graph.g2o beside it,
    unless that is the map's own.

    Raises InputError: graph.g2o is missing, or a file cannot be written."""
    rows: list[tuple[int, str, str, str, int, str]] = []
    for number, each in enumerate(folder.parts, 1):
        stamps, frame = each.trajectory.stamps, "East-North-Up" if each.in_world else "first pose"
        for scan, stamp, utc in zip(each.scans, stamps.tolist(), utc_texts(stamps), strict=True):
            rows.append((scan, folder.names[scan], repr(stamp), utc, number, frame))
    write_table(path, GRAPH_COLUMNS, sorted(rows))
    if path.parent.resolve() == folder.path.resolve():
        return
    try:
        content = read_content(folder.path / GRAPH)
    except InputError as error:
        raise InputError(f"{error}; map again") from error
    with atomic_path(path.with_name(GRAPH)) as temporary:
        temporary.write_bytes(content)
