"""Joint least-squares fit of a sounder's biases and the lines' navigation errors to overlapping lines."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import coo_array, csr_array

from sonarmap.slam.pings.biases import NAMES, Biases, corrected, velocities
from sonarmap.slam.pings.cells import Overlaps, Patches, keys_of
from sonarmap.slam.pings.line import PingLine

BIASES = len(NAMES)
# Standard deviations of further unknowns, errors of the motion sensor: rotation of its axes about the vertical [rad],
# lever arm to the transducer forward and to port [m]. As the vehicle swings they change heights by millimeters; without
# them, a flat bed would seem to show heading and pitch biases.
MOTION = np.array([np.radians(5.0), 1.0, 1.0])
_FIXED = BIASES + len(MOTION)
_WIDENING = (3.0, 3.0, 2.0)  # of the cells in the first rounds: errors of meters are small beside wide cells
_MAX_ROUNDS = 10  # with cells of the given size
_SMALL_CHANGE = 0.1  # convergence: no bias changes by more in a round [standard deviations]
_MAX_BIAS = 2.0  # [prior standard deviations]
_DEGREES_OF_FREEDOM = 5.0  # of Student's t, for the residuals
_MIN_SCATTER = 0.002  # of heights in a cell [m]
# A slope's effect on heights fades in between these significances, unless cells are widened: over thousands of cells,
# noise in the slopes would look like relief and pretend to show biases.
_NO_SLOPE = 6.0  # [standard deviations]
_FULL_SLOPE = 8.0  # [standard deviations]
_BLOCK = 12  # edge of the blocks within which residuals may be correlated [cells]
_KNOT_INTERVAL = 10.0  # between knots of a line's navigation errors [s]
_MAX_INTERVALS = 24  # per line
_INITIAL_SIGMA = (1.0, 1.0, 0.2)  # of the East, North and Up errors at the beginning of a line [m]
_DRIFT = (0.3, 0.3, 0.03)  # standard deviation of their change in a minute, a random walk [m]


@dataclass(frozen=True, slots=True)
class Knots:
    """Times of the K knots between which a line's navigation errors are interpolated.

    Attributes:
        first: index of the line's first unknown; each knot has three, East, North and Up.
        stamps: (K,) [s], ascending.
    """

    first: int
    stamps: np.ndarray

    @classmethod
    def of(cls, lines: Sequence[PingLine], first: int) -> "list[Knots]":
        """Knots of each line; `first` is the index of the first unknown."""
        knots: list[Knots] = []
        for line in lines:
            begin, end = float(line.stamps[0]), float(line.stamps[-1])
            count = int(np.clip(np.ceil((end - begin) / _KNOT_INTERVAL), 1, _MAX_INTERVALS)) + 1
            knots.append(cls(first, np.linspace(begin, max(end, begin + 1.0), count)))
            first = knots[-1].end
        return knots

    @property
    def end(self) -> int:
        """Index after the line's last unknown."""
        return self.first + 3 * len(self.stamps)

    def at(self, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the East unknowns at the knots before and after (m,) stamps [s], (m, 2) int64, and weights."""
        k = np.clip(np.searchsorted(self.stamps, stamps, side="right") - 1, 0, len(self.stamps) - 2)
        share = (stamps - self.stamps[k]) / (self.stamps[k + 1] - self.stamps[k])
        unknowns = self.first + 3 * np.column_stack([k, k + 1])
        return unknowns, np.column_stack([1 - share, share])

    def errors(self, stamps: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """(m, 3) East, North, Up corrections of the places [m] at (m,) stamps [s]."""
        knots = solution[self.first : self.end].reshape(-1, 3)
        return np.column_stack([np.interp(stamps, self.stamps, axis) for axis in knots.T])

    def information(self) -> np.ndarray:
        """(3 K, 3 K) prior information of the unknowns [m^-2]: a random walk from an initial error."""
        count = len(self.stamps)
        steps = np.diff(np.eye(count), axis=0)
        information = np.zeros((3 * count, 3 * count))
        for axis, (sigma, drift) in enumerate(zip(_INITIAL_SIGMA, _DRIFT, strict=True)):
            of_axis = steps.T @ np.diag(60.0 / (np.diff(self.stamps) * drift**2)) @ steps
            of_axis[0, 0] += 1 / sigma**2
            information[axis::3, axis::3] = of_axis
        return information


def fit(lines: Sequence[PingLine], cell: float, mounting: Biases) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """(4,) biases, their covariance (4, 4), and for each line the (P, 3) corrections of its places [m]."""
    knots = Knots.of(lines, _FIXED)
    fixed = np.diag(np.concatenate([mounting.array, MOTION]) ** -2)
    assumed = np.asarray(block_diag(fixed, *(of_line.information() for of_line in knots)))
    solution, covariance = np.zeros(knots[-1].end), np.diag(mounting.array**2)
    near = list(_overlapping(lines, _WIDENING[0] * cell))
    for widened in (*_WIDENING, *[1.0] * _MAX_ROUNDS):
        change, covariance = _step(near, knots, solution, widened * cell, assumed, widened == 1)
        # a bias that hardly shows may take a large step, to where the slopes no longer hold
        change[:BIASES] = np.clip(change[:BIASES], -mounting.array, mounting.array)
        solution = solution + change
        solution[:BIASES] = np.clip(solution[:BIASES], -_MAX_BIAS * mounting.array, _MAX_BIAS * mounting.array)
        if widened == 1 and (np.abs(change[:BIASES]) < _SMALL_CHANGE * np.sqrt(np.diag(covariance))).all():
            break
    errors = [of_line.errors(line.stamps, solution) for line, of_line in zip(lines, knots, strict=True)]
    return solution[:BIASES], covariance, errors


def _overlapping(lines: Sequence[PingLine], cell: float) -> Iterator[PingLine]:
    """The lines, each with only the soundings in cells that another line covers too."""
    keys = [keys_of(line.world_points(), cell) for line in lines]
    cells, counts = np.unique(np.concatenate([np.unique(of_line) for of_line in keys]), return_counts=True)
    for line, of_line in zip(lines, keys, strict=True):
        shared = np.isin(of_line, cells[counts > 1])
        yield replace(line, pings=line.pings[shared], points=line.points[shared])


def _step(
    lines: Sequence[PingLine],
    knots: Sequence[Knots],
    solution: np.ndarray,
    cell: float,
    assumed: np.ndarray,
    gated: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """(U,) Gauss-Newton step of a solution, and (4, 4) covariance of its biases; `assumed` (U, U) is the prior
    information [1 / units of the unknowns squared]."""
    overlaps = _overlaps(lines, knots, solution, cell)
    residuals, weights, bread = _residuals(overlaps)
    rows = _centered(_rows(overlaps, knots, len(solution), gated), overlaps, weights)
    weighted = rows.T * weights
    information = (weighted @ rows).toarray() + assumed
    change = np.linalg.solve(information, weighted @ residuals - assumed @ solution)
    inverse = np.linalg.inv(((rows.T * bread) @ rows).toarray() + assumed)
    return change, _covariance(inverse, rows * (weights * residuals)[:, None], overlaps, assumed)


def _overlaps(lines: Sequence[PingLine], knots: Sequence[Knots], solution: np.ndarray, cell: float) -> Overlaps:
    """Overlaps of the lines after a solution's corrections, with the columns of `_moves`."""
    mean = np.concatenate([line.attitudes[:, :2] for line in lines]).mean(axis=0)
    patches: list[Patches] = []
    for line, of_line in zip(lines, knots, strict=True):
        right = corrected(line, Biases.of(solution[:BIASES]))
        right = replace(right, places=right.places + of_line.errors(line.stamps, solution))
        patches.append(Patches.of(right.world_points(), cell, _moves(right, line.attitudes[:, :2] - mean)))
    overlaps = Overlaps.of(patches, cell)
    raised = overlaps.columns[:, 3 * BIASES : -1] @ solution[BIASES:_FIXED]
    return replace(overlaps, heights=overlaps.heights + raised)


def _residuals(overlaps: Overlaps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (Q,), the cell's mean height less the patch's [m], and their weights and the second derivatives of
    their losses [m^-2]."""
    variances = overlaps.variances + _MIN_SCATTER**2
    share = 1 / variances / _per_cell(1 / variances, overlaps)
    first = overlaps.heights - _per_cell(overlaps.heights / variances, overlaps) * (share * variances)
    scaled = first / np.sqrt(variances * np.maximum(1 - share, 1e-6))
    scale = max(1.4826 * float(np.median(np.abs(scaled))), 1e-6) if len(scaled) else 1.0
    square = (scaled / scale) ** 2 / _DEGREES_OF_FREEDOM
    loss = (1 + 1 / _DEGREES_OF_FREEDOM) / (1 + square) / variances / scale**2
    means = _per_cell(loss * overlaps.heights, overlaps) / _per_cell(loss, overlaps)
    return means - overlaps.heights, loss, loss * np.maximum(1 - square, 0) / (1 + square)


def _covariance(inverse: np.ndarray, scores: csr_array, overlaps: Overlaps, assumed: np.ndarray) -> np.ndarray:
    """(4, 4) covariance of the biases: that of the least squares, with standard deviations raised to those of the
    sandwich estimator (H. White, DOI 10.2307/1912526) with the (Q, U) scores clustered by blocks of cells."""
    numbers = np.floor(overlaps.centers / (_BLOCK * overlaps.cell)).astype(np.int64)
    blocks = np.unique(numbers, axis=0, return_inverse=True)[1].reshape(-1)[overlaps.cells]
    count = int(blocks.max(initial=0)) + 1
    members = coo_array((np.ones(len(blocks)), (blocks, np.arange(len(blocks)))), shape=(count, len(blocks)))
    summed = csr_array(members.tocsr() @ scores).toarray()
    wide = inverse @ (count / max(count - 1, 1) * summed.T @ summed + assumed) @ inverse
    covariance = inverse[:BIASES, :BIASES]
    raised = np.sqrt(np.maximum(np.diag(wide)[:BIASES] / np.diag(covariance), 1))
    return raised[:, None] * covariance * raised


def _moves(line: PingLine, swings: np.ndarray) -> np.ndarray:
    """(N, 16) derivatives of world soundings: East, North, Up by each bias [m per unit], Up by each error of the motion
    sensor [m per unit]; and the soundings' stamps [s]."""
    R_level_vehicle, R_world_level = line.R_level_vehicle, line.T_world_level.rotation
    R = (R_world_level * R_level_vehicle).as_matrix()[line.pings]
    rays = line.points - line.sensors[line.pings]
    x, y, z = np.einsum("nji,nj->in", R_level_vehicle.as_matrix()[line.pings], rays)
    forward, port, up = R[:, :, 0], R[:, :, 1], R[:, :, 2]
    roll = y[:, None] * up - z[:, None] * port
    pitch = x[:, None] * up - z[:, None] * forward
    heading = y[:, None] * forward - x[:, None] * port
    # products of two swings are left out: they are fractions of a millimeter
    inclined = line.attitudes[line.pings, 1]
    pitch[:, 2], heading[:, 2] = -rays[:, 2] * inclined, y * inclined
    rolled, pitched = swings[line.pings].T
    motion = (y * pitched, pitched, rolled)
    return np.column_stack([velocities(line)[line.pings], roll, pitch, heading, *motion, line.stamps[line.pings]])


def _rows(overlaps: Overlaps, knots: Sequence[Knots], unknowns: int, gated: bool) -> csr_array:
    """(Q, U) derivatives of the patches' heights at their cells' centers by the unknowns."""
    steep = np.linalg.norm(overlaps.slopes, axis=1) / np.maximum(overlaps.slope_noise, 1e-9)
    weight = np.clip((steep - _NO_SLOPE) / (_FULL_SLOPE - _NO_SLOPE), 0, 1) if gated else np.ones(len(steep))
    up = np.column_stack([-(overlaps.slopes * weight[:, None]), np.ones(len(steep))])[overlaps.cells]
    count = len(up)
    moves = overlaps.columns[:, : 3 * BIASES].reshape(count, BIASES, 3)
    values = [np.column_stack([np.einsum("qbi,qi->qb", moves, up), overlaps.columns[:, 3 * BIASES : -1]]).ravel()]
    columns, patches = [np.tile(np.arange(_FIXED), count)], [np.repeat(np.arange(count), _FIXED)]
    for number, of_line in enumerate(knots):
        chosen = np.flatnonzero(overlaps.lines == number)
        unknown, share = of_line.at(overlaps.columns[chosen, -1])
        columns.append((unknown[:, :, None] + np.arange(3)).ravel())
        values.append((share[:, :, None] * up[chosen, None, :]).ravel())
        patches.append(np.repeat(chosen, 6))
    entries = (np.concatenate(values), (np.concatenate(patches), np.concatenate(columns)))
    return coo_array(entries, shape=(count, unknowns)).tocsr()


def _per_cell(values: np.ndarray, overlaps: Overlaps) -> np.ndarray:
    """(Q,) sum of the values of all patches in each patch's cell."""
    return np.bincount(overlaps.cells, weights=values, minlength=len(overlaps.centers))[overlaps.cells]


def _centered(rows: csr_array, overlaps: Overlaps, weights: np.ndarray) -> csr_array:
    """The rows less the weighted mean of the rows in the same cell."""
    count, cells = len(weights), overlaps.cells
    shape = (len(overlaps.centers), count)
    means = coo_array((weights / _per_cell(weights, overlaps), (cells, np.arange(count))), shape=shape).tocsr()
    spread = coo_array((np.ones(count), (np.arange(count), cells)), shape=shape[::-1]).tocsr()
    return csr_array(rows - spread @ (means @ rows))
