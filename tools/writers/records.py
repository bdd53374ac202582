"""Points and their columns, packed as the binary formats want them."""

import re
from collections.abc import Mapping

import numpy as np

from kernels.errors import InputError

_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def pack_records(points: np.ndarray, columns: Mapping[str, np.ndarray] | None) -> np.ndarray:
    """(N,) packed little-endian records: x, y, z, then every column in its order.

    Args:
        points: (N, 3), float64 kept, anything else as float32 [m].
        columns: {name: (N,)} of numbers. 64-bit integers, which PLY does not know, become 32-bit ones where
            they all fit and float64 where they don't; booleans become 0 and 1.

    Raises:
        InputError: another shape, a column of another length or without numbers, a name no header can hold.
    """
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
    """The column in a type that PLY and PCD both have."""
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
