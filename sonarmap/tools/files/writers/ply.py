"""PLY, binary little endian, with a scalar property per column."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.records import pack_records

_TYPES = {
    "i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint",
    "f4": "float", "f8": "double",
}  # fmt: skip


def write_ply(path: str | Path, points: np.ndarray, columns: Mapping[str, np.ndarray] | None = None) -> None:
    """Write points (N, 3) [m] and `columns` {name: (N,)}, such as intensity, to PLY, whole or not at all."""
    records = pack_records(points, columns)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment written by sonarmap",
        f"element vertex {len(records)}",
    ]
    for name in records.dtype.names or ():
        dtype = records.dtype[name]
        lines.append(f"property {_TYPES[dtype.kind + str(dtype.itemsize)]} {name}")
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        file.write("\n".join([*lines, "end_header", ""]).encode("ascii"))
        file.write(records.view(np.uint8).data)
