"""PCD 0.7, binary, with a field per column. Coordinates are float32: Open3D reads those of 8 bytes as 0."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.records import float32_origin, pack_records

ORIGIN = "# origin of x, y, z [m]:"  # a comment to other programs; our reader adds it


def write_pcd(path: str | Path, points: np.ndarray, columns: Mapping[str, np.ndarray] | None = None) -> None:
    """Write points (N, 3) [m] and `columns` {name: (N,)}, such as intensity, to PCD, whole or not at all.

    Coordinates are relative to `float32_origin(points)`, a comment of the header where it is not 0; points of float32
    are written as they are.
    """
    exact = points.dtype == np.float32 or points.ndim != 2
    origin = np.zeros(3) if exact else float32_origin(points)
    records = pack_records(points if exact else (points - origin).astype(np.float32), columns)
    names = records.dtype.names or ()
    dtypes = [records.dtype[name] for name in names]
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        *([f"{ORIGIN} {' '.join(f'{x:.17g}' for x in origin.tolist())}"] if origin.any() else []),
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(str(dtype.itemsize) for dtype in dtypes)}",
        f"TYPE {' '.join(dtype.kind.upper() for dtype in dtypes)}",
        f"COUNT {' '.join('1' for _ in names)}",
        f"WIDTH {len(records)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}",
        "DATA binary",
        "",
    ]
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        file.write("\n".join(lines).encode("ascii"))
        file.write(records.view(np.uint8).data)
