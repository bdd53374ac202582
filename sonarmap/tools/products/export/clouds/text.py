# pyright: strict
"""XYZ: a line per point, with its columns by name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.clouds.cloud import Cloud, Portion

_FORMS = {"f": "%.6g", "i": "%d", "u": "%d"}  # of columns, by the kind of their numbers
_AT_A_TIME = 100_000  # lines


def write_xyz(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write blanks between columns, whose names stand behind // in the first line, where CloudCompare looks for them.
    Returns what the columns are."""
    count, names = 0, ()
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="ascii") as file:
        for portion in cloud.portions():
            if not count:
                names = ("x", "y", "z", "stamp", *portion.columns)
                file.write(f"//{' '.join(names)}\n")
            form = " ".join(
                ["%.4f", "%.4f", "%.4f", "%.6f", *(_FORMS[each.dtype.kind] for each in portion.columns.values())]
            )
            for first in range(0, len(portion.points), _AT_A_TIME):
                rows = _rows(portion, slice(first, first + _AT_A_TIME))
                file.writelines(f"{form % row}\n" for row in rows)
            count += len(portion.points)
    return {"points": count, "columns": names, "stamp": "of the scan [s], UTC since 1970 where the scans have times"}


def _rows(portion: Portion, some: slice) -> "zip[tuple[Any, ...]]":
    """The numbers of some points; + 0.0 takes the sign from zeros."""
    places = np.round(portion.points[some], 4) + 0.0
    columns = (column[some].tolist() for column in (*places.T, portion.stamps, *portion.columns.values()))
    return zip(*columns, strict=True)
