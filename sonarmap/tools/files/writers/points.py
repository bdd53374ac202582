"""Writer of point clouds as binary PLY files, with a property per column."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import atomic_path

_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_FLOAT32_REACH = 2048.0  # coordinates up to which float32 rounds by 0.06 mm at most [m]
_PLY_TYPES = {
    "i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint",
    "f4": "float", "f8": "double",
}  # fmt: skip


def write_ply(path: str | Path, points: np.ndarray, columns: Mapping[str, np.ndarray] | None = None) -> None:
    """Write points (N, 3) [m] and `columns` {name: (N,)}, such as intensity, to a binary PLY file (little endian)."""
    records = pack_records(points, columns)
    fields = [(name, records.dtype[name]) for name in records.dtype.names or ()]
    lines = [
        *("ply", "format binary_little_endian 1.0", "comment written by sonarmap", f"element vertex {len(records)}"),
        *(f"property {_PLY_TYPES[dtype.kind + str(dtype.itemsize)]} {name}" for name, dtype in fields),
        "end_header",
    ]
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        file.write("\n".join([*lines, ""]).encode("ascii"))
        file.write(records.view(np.uint8).data)


def pack_records(points: np.ndarray, columns: Mapping[str, np.ndarray] | None) -> np.ndarray:
    """Packed little-endian records (N,) of x, y, z and the columns {name: (N,)} in their order. Points (N, 3) [m] stay
    float64, or become float32 if they are of any other type. 64-bit integers, which PLY does not have, become 32-bit
    integers if all values fit, otherwise float64; booleans become 0 and 1."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points to write have shape {points.shape}; wanted (N, 3)")
    points = points.astype(np.float64 if points.dtype == np.float64 else np.float32, copy=False)
    values = {axis: points[:, index] for index, axis in enumerate("xyz")}
    for name, column in (columns or {}).items():
        if name in values or _NAME.fullmatch(name) is None:
            raise InputError(f"a column is called {name!r}; wanted a new name of letters, digits and _")
        if np.shape(column) != (len(points),):
            raise InputError(f"column {name} has shape {np.shape(column)}; wanted ({len(points)},), one per point")
        values[name] = _portable(name, np.asarray(column))
    layout = np.dtype([(name, column.dtype.newbyteorder("<")) for name, column in values.items()])
    records = np.empty(len(points), layout)
    for name, column in values.items():
        records[name] = column
    return records


def _portable(name: str, column: np.ndarray) -> np.ndarray:
    """The column in a type that PLY has."""
    kind, size = column.dtype.kind, column.dtype.itemsize
    if kind not in "fiub":
        raise InputError(f"column {name} holds {column.dtype}; wanted numbers")
    if kind == "b":
        return column.astype(np.uint8)
    if kind == "f":
        return column.astype(np.float32 if size <= 4 else np.float64, copy=False)
    if size < 8:
        return column
    limits = np.iinfo(np.int32)
    fits = column.size == 0 or (column.min() >= limits.min and column.max() <= limits.max)
    return column.astype(np.int32 if fits else np.float64)


def float32_origin(points: np.ndarray) -> np.ndarray:
    """Offset (3,) float64 to subtract from points (N, 3) [m] so that float32 keeps them to 0.1 mm: a multiple of 100 m,
    and 0 along axes on which all points lie within 2048 m. For points more than 4 km apart the rounding error grows in
    proportion: 0.12 mm up to 4 km from the offset."""
    if len(points) == 0:
        return np.zeros(3)
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    near = np.maximum(np.abs(low), np.abs(high)) <= _FLOAT32_REACH
    return np.where(near, 0.0, np.round((low + high) / 2, -2))
