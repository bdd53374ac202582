"""Differences between passes over the same place, as observed and as the poses' joint covariance predicts them.

Where the observed differences, which contain the soundings' noise too, are much larger than the predicted ones, the
stated uncertainties are too small.
"""

from dataclasses import dataclass

import numpy as np

from sonarmap.slam.graph.pose_covariance import joint_covariance
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, LINES
from sonarmap.tools.files.readers.trajectory import read_graph_json
from sonarmap.tools.files.user_file import read_json
from sonarmap.tools.products.compare.surface import levers

_MEDIAN = 0.67449  # median of |x| / sigma of a normal distribution
_MOST = 50  # largest number of crossings whose covariances are computed


@dataclass(frozen=True, slots=True)
class CrossingCheck:
    """Crossings of a map's scans, and of its survey lines if it has any; None where nothing crosses.

    Attributes:
        pairs: number of pairs of scans that cross.
        observed_m, predicted_m: medians of the distance between two scans [m].
        lines_observed_m, lines_predicted_m: standard deviations of the difference of two lines' heights [m]; the
            prediction is that of the crossing scans.
    """

    pairs: int
    observed_m: float | None
    predicted_m: float | None
    lines_observed_m: float | None
    lines_predicted_m: float | None


def relative_sigmas(joint: np.ndarray, pairs: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(m,) standard deviation [m] of the difference of two scans' heights of a place.

    Args:
        joint: (6 n, 6 n) covariance of n poses, left tangents, rotation first [rad, m].
        pairs: (m, 2) int, indices of the two poses.
        places: (m, 3) [m], in the frame of the poses.
    """
    J = levers(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)))
    blocks, (i, j) = joint.reshape(len(joint) // 6, 6, -1, 6), pairs.T
    relative = blocks[i, :, i] + blocks[j, :, j] - blocks[i, :, j] - blocks[j, :, i]
    return np.sqrt(np.maximum(np.einsum("ma,mab,mb->m", J, relative, J), 0.0))


def crossing_check(folder: Map) -> CrossingCheck:
    """Observed and predicted crossings of the map's largest part."""
    part, lines = folder.parts[0], None
    rows = [row for row in folder.graph["crossings"] if {row["i"], row["j"]} <= set(part.scans)]
    if (folder.path / LINES).is_file():
        crossings = read_json(folder.path / LINES, "the lines.json of a map")["crossings"]
        lines = crossings and crossings["after"]["all"]["std_m"]
    if not rows:
        return CrossingCheck(0, None, None, lines, None)
    some = rows[:: -(-len(rows) // _MOST)]
    scans, pairs = np.unique([[row["i"], row["j"]] for row in some], return_inverse=True)
    joint = joint_covariance(read_graph_json(folder.path / FULL_GRAPH), scans.tolist())
    # the place of a crossing is the middle of both scans' points, or of the map if it has none of these
    seen = [part.points[np.isin(part.columns["scan"], (row["i"], row["j"]))] for row in some]
    places = np.array([(points if len(points) else part.points).mean(axis=0) for points in seen])
    sigmas = relative_sigmas(joint, pairs.reshape(-1, 2), places)
    observed, predicted = np.median([row["after_m"] for row in some]), _MEDIAN * np.median(sigmas)
    of_lines = None if lines is None else float(np.sqrt((sigmas**2).mean()))
    return CrossingCheck(len(rows), float(observed), float(predicted), lines, of_lines)
