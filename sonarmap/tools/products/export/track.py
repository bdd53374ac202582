"""Track and poses of a map: features as GeoJSON and GeoPackage; tables as poses.csv, files for EIVA, and graph.csv.

EIVA NaviEdit's files are in the formats "NavLab" for position and attitude of its support page "Merge format", without
a line of names: https://eiva.freshdesk.com/support/solutions/articles/43000529417.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.map_folder.names import GRAPH
from sonarmap.tools.files.time_scales import utc_texts
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.tables import write_json, write_table
from sonarmap.tools.products.export.georeferenced import Georeferenced

_POINT_Z, _LINE_Z = 1001, 1002  # ISO WKB
_VERSION = "1.2"  # of a GeoPackage: programs of 2017 and later read it
_UTC = 100  # GDAL's flag of a time zone
LAYERS = ("track", "scans", "loops")
ANGLES = ("roll_deg", "pitch_deg", "heading_deg")
SIGMAS = ("east_sigma_m", "north_sigma_m", "up_sigma_m", "roll_sigma_deg", "pitch_sigma_deg", "heading_sigma_deg")
_ERRORS = ("east", "north", "up", "rot_east", "rot_north", "rot_up")
_UPPER = tuple(combinations_with_replacement(range(6), 2))
_UNITS = ("m2", "m_rad", "rad2")  # of covariances, by the number of rotations among the two errors
COVARIANCES = tuple(f"cov_{_ERRORS[i]}_{_ERRORS[j]}_{_UNITS[(i > 2) + (j > 2)]}" for i, j in _UPPER)
COLUMNS = (
    *("name", "scan", "utc", "unix_s", "lat_deg", "lon_deg", "easting_m", "northing_m", "depth_m", "height_m"),
    *("heave_m", *ANGLES, "heading_grid_deg", "convergence_deg", *SIGMAS),
    *COVARIANCES,
    *("crs", "height_reference"),
)
GRAPH_COLUMNS = ("vertex", "name", "stamp", "utc", "map", "frame")


@dataclass(frozen=True, slots=True)
class Feature:
    """A point or a line through scans."""

    layer: str  # a name of LAYERS
    scans: np.ndarray  # (k,) indices into the part's scans that it passes through; 1 for a point
    attributes: dict[str, Any]  # the same names for all features of a layer; None for unknown values


def features_of(earth: Georeferenced) -> list[Feature]:
    """Features of one part of a map, layer by layer; one track for each survey with two or more scans."""
    heights = {"height_reference": earth.georeference.vertical}
    return [
        *(Feature("track", line, _track(earth, line) | heights) for line in earth.lines),
        *(Feature("scans", np.array([k]), _scan(earth, k) | heights) for k in range(len(earth.part.scans))),
        *_loops(earth),
    ]


def _track(earth: Georeferenced, line: np.ndarray) -> dict[str, Any]:
    by_time = line[np.argsort(earth.stamps[line], kind="stable")]
    return {
        "survey": earth.surveys[int(line[0])],
        "scan_count": len(line),
        "first_utc": earth.utc[int(by_time[0])] or None,
        "last_utc": earth.utc[int(by_time[-1])] or None,
    }


def _scan(earth: Georeferenced, k: int) -> dict[str, Any]:
    height = float(earth.poses[k, 2])
    sigmas = [sigma if np.isfinite(sigma) else None for sigma in earth.sigmas[k].tolist()]
    return {
        "name": earth.names[k],
        "scan": earth.part.scans[k],
        "survey": earth.surveys[k],
        "utc": earth.utc[k] or None,
        "unix_s": float(earth.stamps[k]) if earth.timed else None,
        "depth_m": -height + 0.0,
        "height_m": height,
        **dict(zip(ANGLES, earth.attitudes[k].tolist(), strict=True)),
        "heading_grid_deg": float(earth.grid_headings[k]),
        **dict(zip(SIGMAS, sigmas, strict=True)),
    }


def _loops(earth: Georeferenced) -> Iterator[Feature]:
    """Lines of the loops within this part, from target to source."""
    index, names = {scan: k for k, scan in enumerate(earth.part.scans)}, earth.folder.names
    for loop in earth.folder.loops:
        if loop.target in index and loop.source in index:
            ends = {"target": names[loop.target], "source": names[loop.source]}
            attributes = {**ends, "kept": loop.kept, "reason": loop.reason}
            yield Feature("loops", np.array([index[loop.target], index[loop.source]]), attributes)


def write_geojson(path: Path, earth: Georeferenced) -> None:
    """Write a FeatureCollection (RFC 7946) of longitude, latitude [deg, WGS84] and height [m].

    Against the RFC, longitudes of a line continue beyond the 180th meridian, and heights count from `height_reference`,
    not always the WGS84 ellipsoid. The property `layer` is a name of LAYERS."""
    features = [_feature(each, earth.poses[each.scans][:, [1, 0, 2]]) for each in features_of(earth)]
    write_json(path, {"type": "FeatureCollection", "features": features})


def _feature(feature: Feature, places: np.ndarray) -> dict[str, Any]:
    """A feature through points (k, 3) of longitude, latitude, height."""
    places = np.column_stack([np.unwrap(places[:, 0], period=360.0), places[:, 1:]])
    points = [[round(x, 10), round(y, 10), round(z, 5)] for x, y, z in places.tolist()]  # 1e-10 degrees are 0.01 mm
    geometry: dict[str, Any] = {"type": "LineString", "coordinates": points}
    if len(points) == 1:
        geometry = {"type": "Point", "coordinates": points[0]}
    return {"type": "Feature", "geometry": geometry, "properties": {"layer": feature.layer} | feature.attributes}


def write_geopackage(path: Path, earth: Georeferenced) -> None:
    """Write the layers that have features, in the map's projected CRS [m], with the attributes of the GeoJSON file.
    Times are date-times in UTC [ms]; heights count from the attribute `height_reference`."""
    from pyogrio import set_gdal_config_options

    features = features_of(earth)
    # as the time of the last change, the last scan's: the same map gives the same bytes
    last = np.datetime64(int(earth.stamps.max()) if earth.timed else 0, "s")
    with atomic_path(path) as temporary:
        temporary.unlink()  # GDAL would open the empty file, which is no GeoPackage
        set_gdal_config_options({"OGR_CURRENT_DATE": f"{last}.000Z"})
        try:
            for layer in LAYERS:
                if chosen := [feature for feature in features if feature.layer == layer]:
                    _write_layer(temporary, layer, chosen, earth)
        finally:
            set_gdal_config_options({"OGR_CURRENT_DATE": None})


def _write_layer(path: Path, layer: str, features: Sequence[Feature], earth: Georeferenced) -> None:
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyogrio.raw import write

    names = list(features[0].attributes)
    columns = [_column(name, [feature.attributes[name] for feature in features]) for name in names]
    try:
        write(
            str(path),
            np.array([_wkb(earth.projected_poses[feature.scans]) for feature in features], dtype=object),
            [values for values, _ in columns],
            names,
            field_mask=[mask for _, mask in columns],
            layer=layer,
            driver="GPKG",
            geometry_type="Point Z" if layer == "scans" else "LineString Z",
            crs=earth.projection.crs.to_wkt(),
            dataset_options={"VERSION": _VERSION},
            layer_metadata={"HEIGHT_REFERENCE": earth.georeference.vertical},
            gdal_tz_offsets={name: np.full(len(features), _UTC) for name in names if name.endswith("utc")},
        )
    except (DataSourceError, DataLayerError) as error:
        raise OSError(str(error)) from error


def _column(name: str, values: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Values of an attribute as an array, and a mask of the missing ones."""
    missing = np.array([value is None for value in values])
    if name.endswith("utc"):
        times = ["NaT" if value is None else value.removesuffix("Z") for value in values]
        return np.array(times, dtype="datetime64[ms]"), missing
    kind = next((type(value) for value in values if value is not None), float)
    if kind is str:
        texts = ["" if value is None else value.encode("utf-8", "backslashreplace").decode() for value in values]
        return np.array(texts, dtype=object), missing
    filled = [kind(0) if value is None else value for value in values]
    return np.array(filled, dtype={bool: np.bool_, int: np.int64, float: np.float64}[kind]), missing


def _wkb(places: np.ndarray) -> bytes:
    """Well-known binary of a point (1, 3) or a line (n, 3)."""
    head = struct.pack("<BI", 1, _POINT_Z) if len(places) == 1 else struct.pack("<BII", 1, _LINE_Z, len(places))
    return head + np.ascontiguousarray(places, "<f8").tobytes()


def write_poses_csv(path: Path, earth: Georeferenced) -> None:
    """Write one row of COLUMNS per scan, in the order of the survey. There is no comment line: Excel, QGIS and Python's
    csv do not skip one."""
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
    """Cells from latitude to heave; 1e-10 degrees are 0.01 mm."""
    *degrees, height = earth.poses[k].tolist()
    lengths = [*earth.projected_poses[k, :2].tolist(), -height, height, 0.0]
    return [*(f"{angle:z.10f}" for angle in degrees), *(f"{length:z.5f}" for length in lengths)]


def _angles(earth: Georeferenced, k: int) -> list[str]:
    """Cells from roll to convergence; a heading of 359.9999999 is written as 0."""
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
    """Write name, time and frame of every vertex, which g2o cannot hold, to `path`, and graph.g2o beside it unless it
    is in the map's own folder."""
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
