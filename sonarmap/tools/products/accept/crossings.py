"""Differences between passes over the same place, as observed and as the poses' covariances predict them.

Two scans' heights of a place differ by the relative error of their poses, and by noise. Where the observed differences
are much larger than predicted, the stated uncertainties are too small.
"""

from dataclasses import dataclass

import numpy as np

from sonarmap.slam.graph.pose_covariance import joint_covariance
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, LINES, as_written
from sonarmap.tools.files.readers.trajectory import read_graph_json
from sonarmap.tools.files.user_file import read_json
from sonarmap.tools.products.accept.cells import DepthCells
from sonarmap.tools.products.compare.surface import levers

_MEDIAN = 0.67449  # median of |x| / sigma of a normal distribution
_PLANE = 1 + 1 / 8  # variance of a point's distance from the plane through eight others, over its own
_MOST = 50  # largest number of crossings whose covariances are computed


@dataclass(frozen=True, slots=True)
class CrossingCheck:
    """Crossings of a map's scans, and of its survey lines if it has any; None where nothing crosses.

    Attributes:
        pairs: number of pairs of scans that cross.
        observed_m, predicted_m: medians of the distance between two scans [m].
        lines_observed_m, lines_predicted_m: standard deviations of the difference of two lines' heights [m]; the
            prediction is that of the crossing scans' poses.
    """

    pairs: int
    observed_m: float | None = None
    predicted_m: float | None = None
    lines_observed_m: float | None = None
    lines_predicted_m: float | None = None


def relative_sigmas(joint: np.ndarray, pairs: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(m,) standard deviation [m] of the difference of two scans' heights of a place.

    Args:
        joint: (6 n, 6 n) covariance of n poses, left tangents, rotation first [rad, m].
        pairs: (m, 2) int, indices of the two poses.
        places: (m, 3) [m], in the frame of the poses.
    """
    J = levers(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)))
    blocks = joint.reshape(len(joint) // 6, 6, -1, 6)
    i, j = pairs.T
    relative = blocks[i, :, i] + blocks[j, :, j] - blocks[i, :, j] - blocks[j, :, i]
    return np.sqrt(np.maximum(np.einsum("ma,mab,mb->m", J, relative, J), 0.0))


def crossing_check(folder: Map, cells: DepthCells) -> CrossingCheck:
    """Observed and predicted crossings of the map's largest part."""
    part = folder.parts[0]
    rows = [row for row in folder.graph.get("crossings") or () if row["i"] in part.scans and row["j"] in part.scans]
    lines = _lines_observed(folder)
    if not rows:
        return CrossingCheck(0, lines_observed_m=lines)
    some = rows[:: -(-len(rows) // _MOST)]
    scans, pairs = np.unique([[row["i"], row["j"]] for row in some], return_inverse=True)
    joint = joint_covariance(read_graph_json(folder.path / FULL_GRAPH), scans.tolist())
    # the place of a crossing is the middle of both scans' points, or of the map if it has none of these
    seen = [part.points[np.isin(part.columns["scan"], (row["i"], row["j"]))] for row in some]
    places = np.array([(points if len(points) else part.points).mean(axis=0) for points in seen])
    sigmas = relative_sigmas(joint, pairs.reshape(-1, 2), places)
    noise = float(np.median(cells.scatter))
    return CrossingCheck(
        len(rows),
        float(np.median([row["after_m"] for row in some])),
        float(np.median(_MEDIAN * np.sqrt(sigmas**2 + _PLANE * noise**2))),
        lines,
        None if lines is None else float(np.sqrt((sigmas**2).mean())),
    )


def _lines_observed(folder: Map) -> float | None:
    """Standard deviation of the differences of lines in lines.json [m]; None without."""
    path = folder.path / LINES
    if not path.is_file():
        return None
    with as_written(folder.path):
        crossings = read_json(path, "the lines.json of a map")["crossings"]
        return crossings and crossings["after"]["all"]["std_m"]
