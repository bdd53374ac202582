"""The points that the map left out as false echoes, packed for the page."""

import math
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
from sonarmap.tools.files.readers.clouds.ply import read_ply_columns
from sonarmap.tools.products.report.page.points import MOST_CODE, Packed, pack

MOST_DOUBTFUL = 300_000  # points, so that they add about 2 MB to the page at most


def doubtful_of(folder: MapFolder, part: MapPart) -> tuple[Packed, dict[str, Any]] | None:
    """The doubtful points of a part, evenly thinned where there are more than MOST_DOUBTFUL, and how many there are;
    None where the map has none.

    Raises:
        InputError: map_all.ply is damaged.
    """
    name = f"map_all{part.suffix}.ply"
    if name not in folder.summary.get("files", ()) or not (folder.path / name).is_file():
        return None
    try:
        columns = read_ply_columns((folder.path / name).read_bytes())
        left_out = columns["doubtful"] == 1
        points = np.column_stack([columns[axis][left_out].astype(np.float64) for axis in "xyz"])
        scans = columns["scan"][left_out]
        votes = {name: np.clip(columns[name][left_out], 0, MOST_CODE) for name in ("seen", "looked")}
    except (InputError, KeyError, OSError) as error:
        raise InputError(f"{folder.path / name} is damaged ({error}); map again") from error
    if not (np.isfinite(points).all() and np.isin(scans, part.scans).all()):
        raise InputError(f"{folder.path / name} holds points that are not finite, or of other scans; map again")
    if not len(points):
        return None
    thinned = slice(None, None, math.ceil(len(points) / MOST_DOUBTFUL))
    shown = {name: column[thinned] for name, column in {**votes, "scan": scans}.items()}
    return pack(points[thinned], shown, folder.voxel), {"all": len(points), "count": len(points[thinned])}
