"""Point clouds to files. A new format is a file here and a row of WRITERS."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.pcd import write_pcd
from sonarmap.tools.files.writers.ply import write_ply

WRITERS = {".ply": write_ply, ".pcd": write_pcd}

__all__ = ["WRITERS", "write_pcd", "write_ply", "write_points"]


def write_points(path: str | Path, points: np.ndarray, columns: Mapping[str, np.ndarray] | None = None) -> None:
    """Write points (N, 3) [m] and `columns` {name: (N,)} in the format that the suffix of `path` names. Raises
    InputError: an unknown suffix, a path that cannot be written, or see `pack_records`."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(f"cannot write {path}: unknown format {suffix!r}; known formats are {', '.join(WRITERS)}")
    WRITERS[suffix](path, points, columns)
