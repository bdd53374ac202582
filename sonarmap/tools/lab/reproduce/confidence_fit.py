"""Fitting to recorded pairs: the probability of a place, and how far scans slide along what holds them least."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform
from scipy.special import expit

from sonarmap.spectral.covariance import ELLIPSOID, Slide, fit_covariance, slides_of
from sonarmap.spectral.geometry import cross_matrices
from sonarmap.spectral.grid import coarse_edge
from sonarmap.spectral.judgement import Clues, Odds, fixed_probability, judge, shares
from sonarmap.tools.lab.reproduce.evidence import RecordedPair

CLUES = tuple(field.name for field in fields(Clues))
NEAR = 12.0, 8.0  # a place is right within these of the truth [degrees, voxels]
_RIDGE = 1e-3  # weight of the squared weights in the mean loss, of columns with deviation 1
_RARE = 0.005  # share of the pairs on either side that say nothing of a clue's range
# A place that is farther off is wrong, whatever its covariance says [degrees, voxels]
_FARTHEST = 30.0, 40.0
# Scans have slid if they are farther off than so many standard deviations by their planes, and than so many coarse
# voxels; up to so many, as far as the correlation is looked at
_SIGMAS, _LEAST, _COARSE = 2.5, 1.5, 12.0


def fit_odds(clues: np.ndarray, right: np.ndarray, share: np.ndarray, start: Odds | None = None) -> Odds:
    """From (N, K) clues of N pairs; each is `right` (N,) with the probability of these odds times its share (N,).

    Those of nearly the same pairs are a good `start`.
    """
    low, high = np.quantile(clues, [_RARE, 1 - _RARE], axis=0)
    within = np.clip(clues, low, high)
    deviation = within.std(axis=0)
    odds = Odds(CLUES, low, high, within.mean(axis=0), np.where(deviation > 0, deviation, 1.0))
    known = None if start is None or start.weights is None else np.append(start.weights, start.constant)
    constant, weights = fit_logistic(odds.columns(clues), right, share, known)
    return replace(odds, constant=constant, weights=weights)


def fit_logistic(
    columns: np.ndarray, right: np.ndarray, share: np.ndarray | float = 1.0, start: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Constant and weights of log odds by maximum likelihood, linear in (N, M) columns of a deviation of about 1.

    Each row is `right` with the probability of these odds times its share. A small weight on the squares of the weights
    keeps these finite. The search begins at `start` (M + 1,), weights and constant.
    """
    x = np.column_stack([columns, np.ones(len(columns))])
    ridge = np.append(np.full(columns.shape[1], _RIDGE), _RIDGE**2)

    def probability(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        clear = expit(x @ weights)
        return np.clip(clear * share, 1e-9, 1 - 1e-9), share * clear * (1 - clear)

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        p, slope = probability(weights)
        value = -np.where(right, np.log(p), np.log1p(-p)).mean() + ridge @ weights**2 / 2
        return float(value), x.T @ (np.where(right, -1 / p, 1 / (1 - p)) * slope) / len(x) + ridge * weights

    def information(weights: np.ndarray) -> np.ndarray:
        p, slope = probability(weights)
        return (x.T * (slope**2 / (p * (1 - p)))) @ x / len(x) + np.diag(ridge)

    begin = np.zeros(x.shape[1]) if start is None else start
    found = minimize(loss, begin, jac=True, hess=information, method="trust-krylov").x
    return float(found[-1]), found[:-1]


@dataclass(frozen=True, slots=True)
class JudgedPairs:
    """N recorded pairs with their covariances, and what their probability is to be made of."""

    pairs: Sequence[RecordedPair]
    clues: np.ndarray  # (N, K) the CLUES of each
    share: np.ndarray  # (N,) of the probability that the best hypothesis has by its score
    nees: np.ndarray  # (N,) squared error over covariance; NaN where no pose is right
    fixed: np.ndarray  # (N,) probability that the pose is fixed
    sigma: np.ndarray  # (N,) standard deviation along the least sure direction [voxels]

    @property
    def near(self) -> np.ndarray:
        """(N,) whether the place is right, however sure the pose."""
        return np.array([(pair.off[0] <= NEAR).all() for pair in self.pairs])

    @property
    def right(self) -> np.ndarray:
        """(N,) whether the place is right, or as far off as the covariance says."""
        off = np.array([pair.off[0] for pair in self.pairs])
        return self.near | ((self.nees <= ELLIPSOID) & (off <= _FARTHEST).all(axis=1))

    def probability(self, odds: Odds) -> np.ndarray:
        """(N,) that the best hypothesis names the right place."""
        return expit(odds.of(self.clues)) * self.share


def judged(pairs: Sequence[RecordedPair], slide: Slide) -> JudgedPairs:
    """The pairs, by the rules of the package but for how far scans slide."""
    rows = []
    for pair in pairs:
        best, voxel = pair.hypotheses[0], pair.grid.voxel
        covariance = fit_covariance(best, pair.centers, pair.grid, pair.seen, slide)
        search = float(pair.cells["search"])
        kept, _, clues = judge(pair.hypotheses, pair.T, covariance.posterior, pair.seen, pair.grid, search)
        share = shares([pair.hypotheses[n] for n in kept])[0]
        nees = float(pair.xi @ np.linalg.solve(covariance.posterior, pair.xi))
        fixed = fixed_probability(covariance.posterior, voxel, covariance.by_instruments)
        sigma = np.sqrt(np.linalg.eigvalsh(covariance.posterior[3:, 3:])[-1]) / voxel
        rows.append((*asdict(clues).values(), share, nees, fixed, sigma))
    table = np.array(rows).reshape(len(pairs), len(CLUES) + 4)
    return JudgedPairs(pairs, table[:, : len(CLUES)], *table[:, len(CLUES) :].T)


def fit_slide(pairs: Sequence[RecordedPair]) -> Slide:
    """How far scans slide, from pairs whose place is right as far as the correlation was looked at."""
    slides, slid, far = [], [], []
    for pair in pairs:
        voxel, coarse = pair.grid.voxel, pair.grid.edge / coarse_edge(pair.grid.edge)
        if pair.off[0, 0] > NEAR[0] or pair.off[0, 1] > _COARSE * coarse:
            continue
        covariance = fit_covariance(pair.hypotheses[0], pair.centers, pair.grid).posterior
        R, center = pair.hypotheses[0].fit.R, pair.centers[1]
        # what an error at the sensor moves the source's grid center by, along the axes
        along = pair.seen.axes.T @ R.as_matrix() / voxel
        moved = along @ (RigidTransform.from_exp_coords(pair.xi).apply(center) - center)
        jacobian = along @ np.hstack([-cross_matrices(center[None])[0], np.eye(3)])
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian))
        slides.append(slides_of(pair.seen)[:, 0])
        slid.append((np.abs(moved) > _SIGMAS * sigma) & (np.abs(moved) > _LEAST * coarse))
        far.append(moved / coarse)
    ways = np.concatenate(far)[np.concatenate(slid)]
    odds, weights = fit_logistic(np.concatenate(slides)[:, None], np.concatenate(slid))
    return Slide(odds, float(weights[0]), float(np.sqrt(np.mean(ways**2))) if len(ways) else 0.0)
