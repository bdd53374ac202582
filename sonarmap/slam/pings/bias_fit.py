"""Biases and the lines' navigation errors at once, by least squares over the differences of overlapping lines."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import coo_array, csr_array

from sonarmap.slam.pings.biases import NAMES, Biases, corrected, velocities
from sonarmap.slam.pings.cells import Overlaps, Patches, keys_of
from sonarmap.slam.pings.line import PingLine

BIASES = len(NAMES)
# Errors of the motion sensor that are unknowns, too, with standard deviations: how far its axes are turned about the
# vertical [rad], and where it sits from the transducer, forward and to port [m]. As the vehicle swings they raise and
# lower soundings as heading and pitch do, by millimeters, which would seem to show these on a flat bed.
MOTION = np.array([np.radians(5.0), 1.0, 1.0])
_FIXED = BIASES + len(MOTION)
# Factors by which cells are wider in the first rounds, so that errors of meters are small beside the bed's forms.
_WIDENED = (3.0, 3.0, 2.0)
_MOST_ROUNDS = 10  # with the cells themselves
_SMALL_CHANGE = 0.1  # of every bias, which ends them [standard deviations]
_LARGEST_BIAS = 2.0  # [standard deviations as assumed before]
_DEGREES_OF_FREEDOM = 5.0  # of Student's t, for the residuals
_LEAST_SCATTER = 0.002  # of heights in a cell [m]
# Slopes of fewer than the first number of their noise move no heights, those of more than the second do so in full: on
# thousands of cells noise would look like relief, on which the biases show. In wide cells all do.
_SURE = (6.0, 8.0)
_BLOCK = 12  # edge of the blocks of cells within which residuals may be correlated
# Knots of a line's navigation errors
_INTERVAL = 10.0  # between knots [s]
_MOST_INTERVALS = 24  # of a line
_CONSTANT = (1.0, 1.0, 0.2)  # standard deviations of East, North and Up at the beginning of a line [m]
_DRIFT = (0.3, 0.3, 0.03)  # by which they change in a minute, as a random walk [m]


@dataclass(frozen=True, slots=True)
class Knots:
    """At which times a line's errors are unknowns, K times.

    Attributes:
        first: number of its first unknown among all; three per knot, East, North, Up.
        stamps: (K,) [s], ascending.
    """

    first: int
    stamps: np.ndarray

    @classmethod
    def of(cls, lines: Sequence[PingLine], first: int) -> "list[Knots]":
        """Of each line, the first unknown of the first one given."""
        knots: list[Knots] = []
        for line in lines:
            begin, end = float(line.stamps[0]), float(line.stamps[-1])
            count = int(np.clip(np.ceil((end - begin) / _INTERVAL), 1, _MOST_INTERVALS)) + 1
            knots.append(cls(first, np.linspace(begin, max(end, begin + 1.0), count)))
            first = knots[-1].end
        return knots

    @property
    def end(self) -> int:
        """Number behind its last unknown."""
        return self.first + 3 * len(self.stamps)

    def at(self, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For (m,) stamps [s]: the unknowns of East at the knots before and behind, (m, 2) int64, and their shares."""
        k = np.clip(np.searchsorted(self.stamps, stamps, side="right") - 1, 0, len(self.stamps) - 2)
        share = (stamps - self.stamps[k]) / (self.stamps[k + 1] - self.stamps[k])
        unknowns = self.first + 3 * np.column_stack([k, k + 1])
        return unknowns, np.column_stack([1 - share, share])

    def errors(self, stamps: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """(m, 3) East, North, Up to add to places [m] at (m,) stamps [s]."""
        knots = solution[self.first : self.end].reshape(-1, 3)
        return np.column_stack([np.interp(stamps, self.stamps, axis) for axis in knots.T])

    def information(self) -> np.ndarray:
        """(3 K, 3 K) of its unknowns [m^-2]: a constant, from which the errors wander off as a random walk does."""
        count = len(self.stamps)
        steps = np.diff(np.eye(count), axis=0)
        information = np.zeros((3 * count, 3 * count))
        for axis, (constant, drift) in enumerate(zip(_CONSTANT, _DRIFT, strict=True)):
            own = steps.T @ np.diag(60.0 / (np.diff(self.stamps) * drift**2)) @ steps
            own[0, 0] += 1 / constant**2
            information[axis::3, axis::3] = own
        return information


def fit(lines: Sequence[PingLine], cell: float, mounting: Biases) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """(4,) biases, their covariance (4, 4), and of each line (P, 3) what to add to its places [m]."""
    knots = Knots.of(lines, _FIXED)
    fixed = np.diag(np.concatenate([mounting.array, MOTION]) ** -2)
    assumed = np.asarray(block_diag(fixed, *(own.information() for own in knots)))
    solution, covariance = np.zeros(knots[-1].end), np.diag(mounting.array**2)
    near = list(_overlapping(lines, _WIDENED[0] * cell))
    for widened in (*_WIDENED, *[1.0] * _MOST_ROUNDS):
        change, covariance = _step(near, knots, solution, widened * cell, assumed, widened == 1)
        # what hardly shows may seem to be far away, where the bed's slopes are others
        change[:BIASES] = np.clip(change[:BIASES], -mounting.array, mounting.array)
        solution = solution + change
        solution[:BIASES] = np.clip(solution[:BIASES], -_LARGEST_BIAS * mounting.array, _LARGEST_BIAS * mounting.array)
        if widened == 1 and (np.abs(change[:BIASES]) < _SMALL_CHANGE * np.sqrt(np.diag(covariance))).all():
            break
    errors = [own.errors(line.stamps, solution) for line, own in zip(lines, knots, strict=True)]
    return solution[:BIASES], covariance, errors


def _overlapping(lines: Sequence[PingLine], cell: float) -> Iterator[PingLine]:
    """The lines with the soundings alone that lie where several have some."""
    keys = [keys_of(line.world_points(), cell) for line in lines]
    cells, counts = np.unique(np.concatenate([np.unique(own) for own in keys]), return_counts=True)
    for line, own in zip(lines, keys, strict=True):
        chosen = np.isin(own, cells[counts > 1])
        yield replace(line, pings=line.pings[chosen], points=line.points[chosen])


def _step(
    lines: Sequence[PingLine],
    knots: Sequence[Knots],
    solution: np.ndarray,
    cell: float,
    assumed: np.ndarray,
    gated: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """(U,) what to add to a solution, and (4, 4) the covariance of its biases; `assumed` (U, U) is the information
    before [1 / units of the unknowns squared]."""
    overlaps = _overlaps(lines, knots, solution, cell)
    residuals, weights, bread = _residuals(overlaps)
    rows = _centered(_rows(overlaps, knots, len(solution), gated), overlaps, weights)
    weighted = rows.T * weights
    information = (weighted @ rows).toarray() + assumed
    change = np.linalg.solve(information, weighted @ residuals - assumed @ solution)
    inverse = np.linalg.inv(((rows.T * bread) @ rows).toarray() + assumed)
    return change, _covariance(inverse, rows * (weights * residuals)[:, None], overlaps, assumed)


def _overlaps(lines: Sequence[PingLine], knots: Sequence[Knots], solution: np.ndarray, cell: float) -> Overlaps:
    """Of the lines as a solution corrects them, with the columns of `_moves`."""
    mean = np.concatenate([line.attitudes[:, :2] for line in lines]).mean(axis=0)
    patches: list[Patches] = []
    for line, own in zip(lines, knots, strict=True):
        right = corrected(line, Biases.of(solution[:BIASES]))
        right = replace(right, places=right.places + own.errors(line.stamps, solution))
        patches.append(Patches.of(right.world_points(), cell, _moves(right, line.attitudes[:, :2] - mean)))
    overlaps = Overlaps.of(patches, cell)
    raised = overlaps.columns[:, 3 * BIASES : -1] @ solution[BIASES:_FIXED]
    return replace(overlaps, heights=overlaps.heights + raised)


def _residuals(overlaps: Overlaps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(Q,) the cell's mean height less the patch's [m], the weight of this, and the second derivative of its loss
    [m^-2]."""
    variances = overlaps.variances + _LEAST_SCATTER**2
    share = 1 / variances / _per_cell(1 / variances, overlaps)
    first = overlaps.heights - _per_cell(overlaps.heights / variances, overlaps) * (share * variances)
    scaled = first / np.sqrt(variances * np.maximum(1 - share, 1e-6))
    scale = max(1.4826 * float(np.median(np.abs(scaled))), 1e-6) if len(scaled) else 1.0
    square = (scaled / scale) ** 2 / _DEGREES_OF_FREEDOM
    loss = (1 + 1 / _DEGREES_OF_FREEDOM) / (1 + square) / variances / scale**2
    means = _per_cell(loss * overlaps.heights, overlaps) / _per_cell(loss, overlaps)
    return means - overlaps.heights, loss, loss * np.maximum(1 - square, 0) / (1 + square)


def _covariance(inverse: np.ndarray, scores: csr_array, overlaps: Overlaps, assumed: np.ndarray) -> np.ndarray:
    """(4, 4) of the biases: that of the least squares, with standard deviations raised to those that the (Q, U) scores
    show where they are correlated within blocks (the sandwich of H. White, DOI 10.2307/1912526, by clusters)."""
    numbers = np.floor(overlaps.centers / (_BLOCK * overlaps.cell)).astype(np.int64)
    blocks = np.unique(numbers, axis=0, return_inverse=True)[1].reshape(-1)[overlaps.cells]
    count = int(blocks.max(initial=0)) + 1
    members = coo_array((np.ones(len(blocks)), (blocks, np.arange(len(blocks)))), shape=(count, len(blocks)))
    summed = csr_array(members.tocsr() @ scores).toarray()
    wide = inverse @ (count / max(count - 1, 1) * summed.T @ summed + assumed) @ inverse
    own = inverse[:BIASES, :BIASES]
    raised = np.sqrt(np.maximum(np.diag(wide)[:BIASES] / np.diag(own), 1))
    return raised[:, None] * own * raised


def _moves(line: PingLine, swings: np.ndarray) -> np.ndarray:
    """(N, 16) what a unit of each bias moves soundings by in the world, East, North, Up of one after the other [m], of
    each error of the motion sensor what it raises them by [m], and their stamps [s]."""
    R_level_vehicle, R_world_level = line.R_level_vehicle, line.T_world_level.rotation
    R = (R_world_level * R_level_vehicle).as_matrix()[line.pings]
    rays = line.points - line.sensors[line.pings]
    x, y, z = np.einsum("nji,nj->in", R_level_vehicle.as_matrix()[line.pings], rays)
    forward, port, up = R[:, :, 0], R[:, :, 1], R[:, :, 2]
    roll = y[:, None] * up - z[:, None] * port
    pitch = x[:, None] * up - z[:, None] * forward
    heading = y[:, None] * forward - x[:, None] * port
    # products of two swings are left out: they are fractions of a millimeter, and nothing else is so exact
    inclined = line.attitudes[line.pings, 1]
    pitch[:, 2], heading[:, 2] = -rays[:, 2] * inclined, y * inclined
    rolled, pitched = swings[line.pings].T
    motion = (y * pitched, pitched, rolled)
    return np.column_stack([velocities(line)[line.pings], roll, pitch, heading, *motion, line.stamps[line.pings]])


def _rows(overlaps: Overlaps, knots: Sequence[Knots], unknowns: int, gated: bool) -> csr_array:
    """(Q, U) what a unit of each unknown changes the patches' heights at their cells' centers by."""
    steep = np.linalg.norm(overlaps.slopes, axis=1) / np.maximum(overlaps.slope_noise, 1e-9)
    sure = np.clip((steep - _SURE[0]) / (_SURE[1] - _SURE[0]), 0, 1) if gated else np.ones(len(steep))
    up = np.column_stack([-(overlaps.slopes * sure[:, None]), np.ones(len(steep))])[overlaps.cells]
    count = len(up)
    moves = overlaps.columns[:, : 3 * BIASES].reshape(count, BIASES, 3)
    values = [np.column_stack([np.einsum("qbi,qi->qb", moves, up), overlaps.columns[:, 3 * BIASES : -1]]).ravel()]
    at, of = [np.tile(np.arange(_FIXED), count)], [np.repeat(np.arange(count), _FIXED)]
    for number, own in enumerate(knots):
        chosen = np.flatnonzero(overlaps.lines == number)
        unknown, share = own.at(overlaps.columns[chosen, -1])
        at.append((unknown[:, :, None] + np.arange(3)).ravel())
        values.append((share[:, :, None] * up[chosen, None, :]).ravel())
        of.append(np.repeat(chosen, 6))
    entries = (np.concatenate(values), (np.concatenate(of), np.concatenate(at)))
    return coo_array(entries, shape=(count, unknowns)).tocsr()


def _per_cell(values: np.ndarray, overlaps: Overlaps) -> np.ndarray:
    """(Q,) the sum over the patches of the same cell."""
    return np.bincount(overlaps.cells, weights=values, minlength=len(overlaps.centers))[overlaps.cells]


def _centered(rows: csr_array, overlaps: Overlaps, weights: np.ndarray) -> csr_array:
    """The rows less the weighted mean of those of the same cell."""
    count, cells = len(weights), overlaps.cells
    shape = (len(overlaps.centers), count)
    means = coo_array((weights / _per_cell(weights, overlaps), (cells, np.arange(count))), shape=shape).tocsr()
    spread = coo_array((np.ones(count), (np.arange(count), cells)), shape=shape[::-1]).tocsr()
    return csr_array(rows - spread @ (means @ rows))
