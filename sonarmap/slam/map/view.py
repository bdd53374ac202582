"""What one scan saw over directions: the nearest surface about each, coarse and fine."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.points.visibility import octahedral_cells
from sonarmap.slam.map.beams import Beams
from sonarmap.spectral.scan import Scan

_BEAMS_PER_CELL = 2.0  # along a side: a finer view has holes between the beams
_EDGES = (16, 256)  # of a view, coarsest and finest [cells]
_LEVELS = 3  # of each view, every next one half as fine, for points whose direction is less sure
_FILLED, _CLOSED = 5, 9  # of the nine cells about a direction, so many have to hold an echo, and hold one each
_ROUNDING = 1 + 1e-6  # the farthest point of a scan is within its own reach
_CROWD = 3  # of so many echoes in a cell the nearest is left out: it may be a wild one


@dataclass(frozen=True, slots=True)
class View:
    """What one scan saw, over directions.

    Attributes:
        R_view_sensor: turns the middle of the beams to the octahedral map's, so that its seams lie behind.
        levels: of every fineness, (edge, edge) float64: the nearest range [m] of each cell and the eight around it;
            NaN where too few of these hold an echo to tell anything.
        closed: of the two finest, (edge, edge) float64: what the nine cells' nearest ranges do not exceed [m]; NaN
            where a beam may have passed between them.
        reach: the farthest range [m].
    """

    R_view_sensor: Rotation
    levels: tuple[np.ndarray, ...]
    closed: tuple[np.ndarray, ...]
    reach: float

    def behind(self, directions: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        """Whether places lie farther than all that was seen about their directions, (n,) bool.

        The second image sees past clumps of false echoes, which beams have in common with their neighbors: of each of
        its cells, four beams wide, the nearest counts, and every one has to hold an echo.

        Args:
            directions: (n, 3), of any length, as `R_view_sensor` turns them.
            ranges: (n,) [m], less what they may err.
        """
        hidden = np.zeros(len(ranges), bool)
        for image in self.closed:
            hidden |= ranges > image.ravel()[octahedral_cells(directions, len(image))]
        return hidden


def view_of(scan: Scan, beams: Beams) -> View:
    """The view of a scan that was seen from one viewpoint."""
    points = scan.points.astype(np.float64)
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    middle = (points / ranges[:, None]).mean(axis=0)
    all_around = np.linalg.norm(middle) < 1e-6
    R_view_sensor = Rotation.identity() if all_around else Rotation.align_vectors([[0.0, 0.0, 1.0]], [middle])[0]
    wanted = np.sqrt(4 * np.pi) / (_BEAMS_PER_CELL * max(beams.spacing, 1e-6))
    edge = int(2 ** np.clip(np.round(np.log2(wanted)), *np.log2(_EDGES)))
    cells = octahedral_cells(R_view_sensor.apply(points), edge)
    order = np.argsort(cells + ranges / (2 * ranges.max()))  # by cell, then by range
    filled, first, count = np.unique(cells[order], return_index=True, return_counts=True)
    near = np.full(edge * edge, np.inf)
    near[filled] = ranges[order[first + (count >= _CROWD)]]
    near = near.reshape(edge, edge)
    levels, closed = [], []
    for fineness in range(_LEVELS):
        levels.append(_spread(near, np.minimum, _FILLED))
        if fineness < 2:
            closed.append(_spread(near, np.maximum, _CLOSED if fineness else _FILLED))
        near = np.minimum(near[::2], near[1::2])  # several times faster than the minimum along two axes
        near = np.minimum(near[:, ::2], near[:, 1::2])
    return View(R_view_sensor, tuple(levels), tuple(closed), _ROUNDING * float(ranges.max()))


def _spread(near: np.ndarray, pick: np.ufunc, least: int) -> np.ndarray:
    """(edge, edge) np.minimum or np.maximum of each cell's nine, NaN where fewer than `least` hold an echo.

    Nothing is known along the rim, where the map's seams are.
    """
    spread = np.full(near.shape, np.nan)
    filled = np.isfinite(near)
    picked = near if pick is np.minimum else np.where(filled, near, -np.inf)
    filled = filled.astype(np.int8)
    for _ in range(2):  # along one side, then along the other
        picked = pick(pick(picked[:-2], picked[1:-1]), picked[2:]).T
        filled = (filled[:-2] + filled[1:-1] + filled[2:]).T
    spread[1:-1, 1:-1] = np.where(filled >= least, picked, np.nan)
    return spread
