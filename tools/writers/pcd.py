"""PCD 0.7, binary, with a field per column."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tools.writers.atomic import atomic_path
from tools.writers.records import pack_records


def write_pcd(path: str | Path, points: np.ndarray, columns: Mapping[str, np.ndarray] | None = None) -> None:
    """Write points (N, 3) [m] and `columns` {name: (N,)}, such as intensity, to PCD, whole or not at all.

    Raises:
        InputError: the path cannot be written, or see `pack_records`.
    """
    records = pack_records(points, columns)
    names = records.dtype.names or ()
    dtypes = [records.dtype[name] for name in names]
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
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
