"""The isotropic chordal cost F of a pose graph, for which a certificate of global optimality exists, and its optimum.

F = sum over edges of kappa |R_j - R_i R_ij|^2 (Frobenius) + tau |t_j - t_i - R_i t_ij|^2, without a factor 1/2, with
tau = 3 / tr(inv(I_t)) and kappa = 3 / (2 tr(inv(I_R))) from the 3x3 diagonal blocks of each edge's information: Rosen,
Carlone, Bandeira and Leonard, SE-Sync (IJRR 2019, DOI 10.1177/0278364918784361), Eq. 12. It is not the full-information
cost that `PoseGraph.optimize` minimizes: it has one weight for an edge's rotation and one for its translation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import gtsam
import numpy as np
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gtsam_poses import START_SIGMA, chordal_start, to_pose3, to_transforms, to_values
from sonarmap.slam.graph.known_pose import GAUGE_SIGMA


@dataclass(frozen=True)
class ChordalProblem:
    """The cost F of n poses and m edges, as arrays."""

    count: int  # n
    # i, j: (m,) int64, the poses of each edge
    i: np.ndarray
    j: np.ndarray
    R: np.ndarray  # (m, 3, 3) and t: (m, 3) [m], of T_i_j
    t: np.ndarray
    kappa: np.ndarray  # (m,) weight of the rotation
    tau: np.ndarray  # (m,) weight of the translation [1/m^2]

    @classmethod
    def of(cls, count: int, edges: Sequence[Edge]) -> "ChordalProblem":
        """From measurements between poses 0..count-1.

        Raises:
            InputError: there is no edge, or one is a prior, which F does not have.
        """
        prior = next((edge for edge in edges if edge.kind == "prior"), None)
        if prior is not None or not edges:
            what = f"pose {prior.i} has a prior" if prior else "the graph has no edge"
            raise InputError(
                f"{what}; the isotropic objective needs edges between poses, and no priors. Use `objective=full`"
            )
        measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in edges]).as_matrix()
        information = np.linalg.inv(np.stack([edge.registration.covariance for edge in edges]))
        rotation, translation = information[:, :3, :3], information[:, 3:, 3:]
        return cls(
            count=count,
            i=np.array([edge.i for edge in edges]),
            j=np.array([edge.j for edge in edges]),
            R=measured[:, :3, :3],
            t=measured[:, :3, 3],
            kappa=1.5 / np.trace(np.linalg.inv(rotation), axis1=1, axis2=2),
            tau=3.0 / np.trace(np.linalg.inv(translation), axis1=1, axis2=2),
        )

    def stacked(self, T: RigidTransform) -> np.ndarray:
        """(4 n, 3) matrix X of n poses: their translations, then their transposed rotations."""
        matrices = T.as_matrix()
        return np.vstack([matrices[:, :3, 3], matrices[:, :3, :3].transpose(0, 2, 1).reshape(-1, 3)])

    def cost(self, T: RigidTransform) -> float:
        """F of n poses."""
        R, t = T.as_matrix()[:, :3, :3], T.translation
        rotations = R[self.j] - R[self.i] @ self.R
        translations = t[self.j] - t[self.i] - np.einsum("mab,mb->ma", R[self.i], self.t)
        turned, moved = (rotations**2).sum(axis=(1, 2)), (translations**2).sum(axis=1)
        return float(self.kappa @ turned + self.tau @ moved)

    @cached_property
    def matrix(self) -> sparse.csc_array:
        """(4 n, 4 n) symmetric M with F = tr(X^T M X), for X of `stacked`."""
        n, m = self.count, len(self.i)
        edge, axes = np.arange(m), np.arange(3)
        of_i, of_j = (n + 3 * pose[:, None] + axes for pose in (self.i, self.j))
        columns = 3 * edge[:, None] + axes
        root_tau, root_kappa = np.sqrt(self.tau), np.sqrt(self.kappa)
        moved = _sparse(
            (4 * n, m),
            (self.j, edge, root_tau),
            (self.i, edge, -root_tau),
            (of_i, np.broadcast_to(edge[:, None], (m, 3)), -root_tau[:, None] * self.t),
        )
        turned = _sparse(
            (4 * n, 3 * m),
            (of_j, columns, np.broadcast_to(root_kappa[:, None], (m, 3))),
            (
                np.broadcast_to(of_i[:, :, None], (m, 3, 3)),
                np.broadcast_to(columns[:, None, :], (m, 3, 3)),
                -root_kappa[:, None, None] * self.R,
            ),
        )
        return sparse.csc_array(moved @ moved.T + turned @ turned.T)


def _sparse(shape: tuple[int, int], *parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> sparse.csc_array:
    """Sparse matrix from parts of rows, columns and values, which have equal shapes."""
    rows, columns, values = (np.concatenate([part[k].ravel() for part in parts]) for k in range(3))
    return sparse.coo_array((values, (rows, columns)), shape=shape).tocsc()


Start = Literal["chordal", "given"]

_MIN_DECREASE = 1e-12  # relative decrease of the cost below which the optimizer has converged
_MAX_ITERATIONS = 200
# The fourth row of a pose's 4x4 matrix, in column-major order: its residuals are 0 whatever their weight.
_FOURTH_ROW = np.array([3, 7, 11, 15])


@dataclass(frozen=True, slots=True)
class IsotropicSolution:
    """The optimum of F."""

    T: RigidTransform  # n poses
    cost_after: float  # F of these poses
    # iterations, converged: the optimizer's iterations, and whether they ended before the limit
    iterations: int
    converged: bool


def optimize_isotropic(problem: ChordalProblem, T: RigidTransform, start: Start = "chordal") -> IsotropicSolution:
    """Minimize F.

    Args:
        problem: its edges join all poses.
        T: n poses; the first stays where it is.
        start: "given", from these poses; "chordal", from the edges alone (`chordal_start`).

    Raises:
        InputError: the equations have no unique or no finite solution.
    """
    factors = _factors(problem)
    try:
        initial = to_values(T) if start == "given" else _chordal(problem, T)
        factors.add(gtsam.PriorFactorPose3(0, initial.atPose3(0), gtsam.noiseModel.Isotropic.Sigma(6, GAUGE_SIGMA)))
        options = gtsam.LevenbergMarquardtParams()
        options.setMaxIterations(_MAX_ITERATIONS)
        options.setRelativeErrorTol(_MIN_DECREASE)
        options.setAbsoluteErrorTol(0.0)
        optimizer = gtsam.LevenbergMarquardtOptimizer(factors, initial, options)
        optimum = optimizer.optimize()
    except RuntimeError as error:
        raise InputError(
            f"the pose graph of {problem.count} poses and {len(problem.i)} edges has no unique solution "
            f"({str(error).strip().splitlines()[0]}); look for information matrices that are far too large or too small"
        ) from error
    after = to_transforms(optimum, problem.count)
    return IsotropicSolution(
        T=T[0] * after[0].inv() * after,
        cost_after=problem.cost(after),
        iterations=optimizer.iterations(),
        converged=optimizer.iterations() < _MAX_ITERATIONS,
    )


def _factors(problem: ChordalProblem) -> gtsam.NonlinearFactorGraph:
    """F, doubled: GTSAM's cost has a factor 1/2.

    The residual of this Frobenius factor of GTSAM, T_i^-1 T_j - T_i_j, does not change when all poses turn. That of the
    other, T_j - T_i T_i_j, does, which makes Gauss-Newton steps far too short along wide bends of the graph: 30
    iterations instead of 5 for sphere2500.
    """
    factors = gtsam.NonlinearFactorGraph()
    weights = np.column_stack(
        [np.repeat(problem.kappa[:, None], 12, axis=1), np.repeat(problem.tau[:, None], 4, axis=1)]
    )
    weights[:, _FOURTH_ROW] = 1.0
    for i, j, T_i_j, weight in zip(problem.i.tolist(), problem.j.tolist(), _measured(problem), weights, strict=True):
        noise = gtsam.noiseModel.Diagonal.Precisions(weight)
        factors.add(gtsam.FrobeniusBetweenFactorNLPose3(i, j, T_i_j, noise))
    return factors


def _chordal(problem: ChordalProblem, T: RigidTransform) -> gtsam.Values:
    """The chordal start of a problem; |R_j - R_i R_ij|^2 is 2 angle^2 to first order, hence the factor 2 of kappa."""
    between = gtsam.NonlinearFactorGraph()
    precisions = np.column_stack([np.repeat(weight[:, None], 3, axis=1) for weight in (2 * problem.kappa, problem.tau)])
    for i, j, T_i_j, weight in zip(problem.i.tolist(), problem.j.tolist(), _measured(problem), precisions, strict=True):
        between.add(gtsam.BetweenFactorPose3(i, j, T_i_j, gtsam.noiseModel.Diagonal.Precisions(weight)))
    between.add(gtsam.PriorFactorPose3(0, to_pose3(T[0]), gtsam.noiseModel.Isotropic.Sigma(6, START_SIGMA)))
    return to_values(chordal_start(between, problem.count))


def _measured(problem: ChordalProblem) -> list[gtsam.Pose3]:
    return [gtsam.Pose3(gtsam.Rot3(R), t) for R, t in zip(problem.R, problem.t, strict=True)]
