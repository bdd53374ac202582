"""Whether a solution of the isotropic cost is its global optimum: SE-Sync's dual certificate.

Rosen, Carlone, Bandeira and Leonard (IJRR 2019, DOI 10.1177/0278364918784361), Sect. 4.2. For symmetric 3x3 blocks
Lambda, multipliers of the rotations' constraints, and S = M - diag(0, Lambda), the cost of any poses X is
tr(X^T S X) + tr(Lambda), and so at least tr(Lambda) + 3 n min(0, lambda), for lambda the lowest eigenvalue of S and n
the number of poses. At the global optimum, unless the noise is large, lambda is 0 and the bound is the cost itself. The
bound holds at any poses. M keeps the translations: eigenvalues of S relative to diag(0, 1) are those of the rotations'
matrix that is left after minimizing over the translations.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import sparse
from scipy.sparse import linalg
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.optimize.chordal import ChordalProblem

Verdict = Literal["certified", "not certified", "not decided"]

GAP = 1e-6  # largest gap of a certified solution to the lower bound, as a share of its cost
_LEAST_COST = 1e-3  # smallest cost to take that share of: measurements agree to a thirtieth of their sigmas
_MAX_GRADIENT = 1e-3  # largest gradient at a local optimum, as a share of the largest multiplier


@dataclass(frozen=True, slots=True)
class Certificate:
    """The verdict of the dual problem on a solution."""

    # "certified": no poses have a cost lower by more than GAP; "not certified": the dual does not exclude a better
    # solution; "not decided": the eigenvalues could not be computed
    verdict: Verdict
    cost: float  # F of the poses
    lowest: float  # the lowest eigenvalue of S; NaN if not computed
    gap: float  # no cost is lower than `cost` by more than this; infinite if not decided
    reason: str  # in words


def certify(problem: ChordalProblem, T: RigidTransform) -> Certificate:
    """The certificate of n poses that the problem's edges connect."""
    n, X = problem.count, problem.stacked(T)
    cost = problem.cost(T)
    blocks, gradient = _multipliers(problem, X)
    scale = float(np.abs(blocks).max()) or 1.0
    allowed = GAP * max(cost, _LEAST_COST)
    held = sparse.block_diag([sparse.csc_array((n, n)), sparse.block_diag(list(blocks))])
    # without the first translation, as shifts of all poses change nothing
    dual = sparse.csc_array(sparse.csc_array(problem.matrix - held)[1:, 1:])
    weights = sparse.diags_array(np.concatenate([np.zeros(n - 1), np.ones(3 * n)])).tocsc()
    try:
        lowest = _lowest(dual, sparse.csc_array(weights), scale, 0.5 * allowed / (3 * n))
    except RuntimeError as error:  # ARPACK's are some of these
        return Certificate("not decided", cost, float("nan"), float("inf"), f"not decided: the dual's {error}")
    gap = max(0.0, cost - float(np.trace(blocks, axis1=1, axis2=2).sum())) + 3 * n * max(0.0, -lowest)
    if gap <= allowed:
        words = f"certified: no poses have a cost lower by more than {gap:.1g}"
        return Certificate("certified", cost, lowest, gap, words)
    falls = np.abs(gradient).max() > _MAX_GRADIENT * scale
    cause = "the cost still falls here" if falls else "this may be a local optimum"
    words = f"not certified: {cause}; costs down to {max(0.0, cost - gap):.6g} are not excluded"
    return Certificate("not certified", cost, lowest, gap, words)


def _multipliers(problem: ChordalProblem, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The constraints' multipliers (n, 3, 3), and the gradient projected to the rotations' tangents (4 n, 3)."""
    n = problem.count
    gradient = problem.matrix @ X
    R = X[n:].reshape(n, 3, 3)
    product = gradient[n:].reshape(n, 3, 3) @ R.transpose(0, 2, 1)
    blocks = (product + product.transpose(0, 2, 1)) / 2
    gradient[n:] -= (blocks @ R).reshape(-1, 3)
    return blocks, gradient


def _lowest(dual: sparse.csc_array, weights: sparse.csc_array, scale: float, tolerance: float) -> float:
    """The lowest eigenvalue of dual x = lambda weights x.

    Three are 0, with the poses as eigenvectors. The shifted matrix has as many negative pivots as there are
    eigenvalues below the shift (Sylvester); the shift is lowered until there are none.
    """
    shift = -max(tolerance, 1e-12 * scale)
    below = _negative_pivots(dual, weights, shift)
    if not below:
        return _nearest(dual, weights, shift)
    low = shift
    while _negative_pivots(dual, weights, low):
        low *= 4
        if -low > 1e6 * scale:
            raise RuntimeError("eigenvalues have no bound")
    return _nearest(dual, weights, low)


def _nearest(dual: sparse.csc_array, weights: sparse.csc_array, shift: float) -> float:
    """The lowest eigenvalue, by inverse iteration about a shift below all of them."""
    count = min(4, len(weights.indptr) - 3)
    values = np.asarray(linalg.eigsh(dual, k=count, M=weights, sigma=shift, which="LM", return_eigenvectors=False))
    return float(values.min())


def _negative_pivots(dual: sparse.csc_array, weights: sparse.csc_array, shift: float) -> int:
    """Number of eigenvalues below the shift."""
    matrix = sparse.csc_array(dual - shift * weights)
    options = {"SymmetricMode": True}
    factors = linalg.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    if not np.array_equal(factors.perm_r, factors.perm_c):
        raise RuntimeError("factorization had to pivot")
    return int((factors.U.diagonal() < 0).sum())
