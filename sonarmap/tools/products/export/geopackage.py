# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Track, scans and loops as an OGC GeoPackage, in the map's projected CRS [m]."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.track_features import LAYERS, Feature, features_of

_POINT_Z, _LINE_Z = 1001, 1002  # ISO WKB
_VERSION = "1.2"  # of the format: programs of 2017 and later read it
_UTC = 100  # GDAL's flag of a time zone


def write_geopackage(path: Path, earth: Georeferenced) -> None:
    """Write the layers track, scans and loops, those that have features; their attributes are GeoJSON's.

    Times are date-times in UTC [ms]. Heights count from the attribute `height_reference`.
    """
    features = features_of(earth)
    with atomic_path(path) as temporary:
        temporary.unlink()  # GDAL opens what is there, and an empty file is no GeoPackage
        for layer in LAYERS:
            chosen = [feature for feature in features if feature.layer == layer]
            if chosen:
                _write_layer(temporary, layer, chosen, earth)


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
    """Values of an attribute, and where there are none."""
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
