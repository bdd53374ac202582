"""Joint least-squares fit of a sounder's biases and the lines' navigation errors to overlapping lines."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csr_array, hstack

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.biases import NAMES, Biases, corrected
from sonarmap.slam.pings.cells import Overlaps, members
from sonarmap.slam.pings.line import PingLine
from sonarmap.spectral.chi_squared import chi_squared

BIASES = len(NAMES)
_WIDTHS = (3, 3, 2, 1, 1, 1, 1)  # of the cells in each round: errors of meters are small beside wide cells
_DEGREES_OF_FREEDOM = 5.0  # of Student's t, for the residuals
_MIN_SLOPE = 6.0  # smallest slope that counts [standard deviations]: over thousands of cells, noise looks like relief
_BLOCK = 12  # edge of the blocks within which residuals may be correlated [cells]
_KNOT_INTERVAL = 10.0  # between knots of a line's navigation errors [s]
_MAX_INTERVALS = 24  # per line
_INITIAL_SIGMA = (1.0, 1.0, 0.2)  # of the East, North and Up errors at the beginning of a line [m]
_DRIFT = (0.3, 0.3, 0.03)  # standard deviation of their change in a minute, a random walk [m]


def fit(lines: Sequence[PingLine], cell: float, mounting: Biases) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """(4,) biases, their covariance (4, 4), and for each line the (P, 3) corrections of its places [m].

    The unknowns are the biases, and of each line the East, North and Up errors at the knots that the longest needs.
    """
    longest = max(float(np.ptp(line.stamps)) for line in lines)
    seconds = max(_KNOT_INTERVAL, longest / _MAX_INTERVALS)
    walks = _walk(seconds, int(np.ceil(longest / seconds)) + 1) * len(lines)
    assumed = np.asarray(block_diag(np.diag(mounting.array**-2), *walks))
    solution, covariance = np.zeros(len(assumed)), np.diag(mounting.array**2)
    at_knots = [(line.stamps - line.stamps[0]) / seconds for line in lines]
    for width in _WIDTHS:
        overlaps = _overlaps(lines, at_knots, solution, width * cell, mounting)
        if not len(overlaps.cells):
            raise InputError(f"{len(lines)} lines overlap only as recorded, not with errors of navigation removed")
        change, covariance = _step(overlaps, len(lines), solution, assumed)
        solution = solution + change
    return solution[:BIASES], covariance, _errors(at_knots, solution)


def _walk(seconds: float, count: int) -> list[np.ndarray]:
    """The (K, K) prior information of the East, North and Up errors at a line's `count` knots [m^-2], a random walk
    from an initial error."""
    changes = np.eye(count) - np.eye(count, k=-1)
    sigmas = np.tile(np.sqrt(seconds / 60) * np.array(_DRIFT), (count, 1))
    sigmas[0] = _INITIAL_SIGMA
    return [changes.T @ (changes / sigma[:, None] ** 2) for sigma in sigmas.T]


def _errors(at_knots: Sequence[np.ndarray], solution: np.ndarray) -> list[np.ndarray]:
    """For each line the (P, 3) East, North, Up corrections of its places [m]; the times of its pings count knots."""
    knots = solution[BIASES:].reshape(len(at_knots), 3, -1)
    return [
        np.column_stack([np.interp(times, np.arange(len(axis)), axis) for axis in of_line])
        for times, of_line in zip(at_knots, knots, strict=True)
    ]


def _overlaps(
    lines: Sequence[PingLine], at_knots: Sequence[np.ndarray], solution: np.ndarray, cell: float, mounting: Biases
) -> Overlaps:
    """Overlaps of the lines after a solution's corrections, with the columns of `_moves` and times in knots."""
    biases, trim = Biases.of(solution[:BIASES]), float(np.concatenate([line.attitudes[:, 1] for line in lines]).mean())
    points: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    for line, times, errors in zip(lines, at_knots, _errors(at_knots, solution), strict=True):
        shifted = replace(line, places=line.places + errors)
        points.append(corrected(shifted, biases).world_points())
        columns.append(np.column_stack([_moves(shifted, points[-1], biases, mounting, trim), times[line.pings]]))
    return Overlaps.of(points, columns, cell)


def _moves(line: PingLine, points: np.ndarray, biases: Biases, mounting: Biases, trim: float) -> np.ndarray:
    """(N, 12) derivatives of world soundings (N, 3) [m]: East, North, Up by each bias [m per unit].

    Heights change by roll, and by heading where the vehicles are pitched by `trim` [rad]. As they swing, heights change
    by millimeters, as they do by errors of the motion sensor, and a flat bed would seem to show more biases than roll.
    """
    y = line.points[:, 1]
    moves: list[np.ndarray] = []
    for bias, (step, up) in enumerate(zip(mounting.array / 10, (0 * y, y, 0 * y, trim * y), strict=True)):
        more = Biases.of(biases.array + step * (np.arange(BIASES) == bias))
        moves += [(corrected(line, more).world_points() - points)[:, :2] / step, up[:, None]]
    return np.hstack(moves)


def _step(overlaps: Overlaps, lines: int, solution: np.ndarray, assumed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(U,) Gauss-Newton step of a solution, and (4, 4) covariance of its biases; `assumed` (U, U) is the prior
    information [1 / units of the unknowns squared]."""
    of_cells = members(overlaps.cells, len(overlaps.centers))
    residuals, weights = _residuals(overlaps, of_cells)
    rows = _rows(overlaps, lines, len(solution))
    means = (of_cells @ (rows * weights[:, None])) / (of_cells @ weights)[:, None]
    rows = csr_array(rows - of_cells.T @ means)
    scores = rows * (weights * residuals)[:, None]
    inverse = np.linalg.inv((rows.T @ (rows * weights[:, None])).toarray() + assumed)
    return inverse @ (scores.sum(axis=0) - assumed @ solution), _covariance(inverse, scores, overlaps, assumed)


def _rows(overlaps: Overlaps, lines: int, unknowns: int) -> csr_array:
    """(Q, U) derivatives of the patches' heights at their cells' centers by the unknowns."""
    shown = np.linalg.norm(overlaps.slopes, axis=1) > _MIN_SLOPE * overlaps.slope_noise
    up = np.column_stack([-overlaps.slopes * shown[:, None], np.ones(len(shown))])[overlaps.cells]
    by_biases = np.einsum("qbi,qi->qb", overlaps.columns[:, :-1].reshape(-1, BIASES, 3), up)
    knots = (unknowns - BIASES) // (3 * lines)
    times = overlaps.columns[:, -1]
    before = np.clip(times.astype(int), 0, knots - 2)
    after = (times - before)[:, None]
    numbers = knots * (3 * overlaps.lines[:, None] + np.arange(3)) + before[:, None]
    values, columns = np.hstack([up * (1 - after), up * after]), np.hstack([numbers, numbers + 1])
    starts = np.arange(0, values.size + 1, 6)
    by_errors = csr_array((values.ravel(), columns.ravel(), starts), shape=(len(up), unknowns - BIASES))
    return csr_array(hstack([by_biases, by_errors]))


def _residuals(overlaps: Overlaps, of_cells: csr_array) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (Q,), the cell's mean height less the patch's [m], and their weights [m^-2]."""

    def departures(weights: np.ndarray) -> np.ndarray:
        means = (of_cells @ (weights * overlaps.heights)) / (of_cells @ weights)
        return means[overlaps.cells] - overlaps.heights

    weights = 1 / overlaps.variances
    cells, patches = len(overlaps.centers), len(overlaps.cells)
    squares = weights * departures(weights) ** 2
    scale = np.median(squares) / chi_squared(0.5, 1) * patches / (patches - cells)
    weights *= (1 + 1 / _DEGREES_OF_FREEDOM) / (1 + squares / scale / _DEGREES_OF_FREEDOM) / scale
    return departures(weights), weights


def _covariance(inverse: np.ndarray, scores: csr_array, overlaps: Overlaps, assumed: np.ndarray) -> np.ndarray:
    """(4, 4) covariance of the biases: that of the least squares, with standard deviations raised to those of the
    sandwich estimator (H. White, DOI 10.2307/1912526) with the (Q, U) scores clustered by blocks of cells."""
    numbers = np.floor(overlaps.centers / (_BLOCK * overlaps.cell)).astype(np.int64)
    blocks = np.unique(numbers, axis=0, return_inverse=True)[1].reshape(-1)[overlaps.cells]
    summed = (members(blocks, int(blocks.max()) + 1) @ scores).toarray()
    wide = inverse @ (summed.T @ summed + assumed) @ inverse
    covariance = inverse[:BIASES, :BIASES]
    raised = np.sqrt(np.maximum(np.diag(wide)[:BIASES] / np.diag(covariance), 1))
    return raised[:, None] * covariance * raised
