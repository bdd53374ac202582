"""The optimum of the isotropic chordal cost, by GTSAM, from where its rotations alone say it is."""

from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.gtsam_poses import START_SIGMA, chordal_start, to_pose3, to_transforms, to_values
from sonarmap.slam.graph.known_pose import GAUGE_SIGMA
from sonarmap.slam.optimize.chordal import ChordalProblem

Start = Literal["chordal", "given"]

# The optimizer rests where a step lowers the cost by less than this share of it.
_REST = 1e-12
_MOST_ITERATIONS = 200
# Rows of a pose's 4x4 matrix that are no unknowns, in its columns' order; their residuals are 0 whatever they weigh.
_IDLE = np.array([3, 7, 11, 15])


@dataclass(frozen=True, slots=True)
class IsotropicSolution:
    """Where the optimizer came to rest.

    Attributes:
        T: n poses.
        cost_before, cost_after: F at the start and at rest.
        iterations, converged: of the optimizer, and whether it came to rest before the limit.
    """

    T: RigidTransform
    cost_before: float
    cost_after: float
    iterations: int
    converged: bool


def optimize_isotropic(problem: ChordalProblem, T: RigidTransform, start: Start = "chordal") -> IsotropicSolution:
    """The poses of least F.

    Args:
        problem: its edges join all poses.
        T: n poses; the first stays where it is.
        start: "given", these poses; "chordal", which does not hear them (`chordal_start`).

    Raises:
        InputError: the equations have no unique or no finite solution.
    """
    factors = _factors(problem)
    try:
        initial = to_values(T) if start == "given" else _chordal(problem, T)
        factors.add(gtsam.PriorFactorPose3(0, initial.atPose3(0), gtsam.noiseModel.Isotropic.Sigma(6, GAUGE_SIGMA)))
        options = gtsam.LevenbergMarquardtParams()
        options.setMaxIterations(_MOST_ITERATIONS)
        options.setRelativeErrorTol(_REST)
        options.setAbsoluteErrorTol(0.0)
        optimizer = gtsam.LevenbergMarquardtOptimizer(factors, initial, options)
        optimum = optimizer.optimize()
    except RuntimeError as error:
        raise InputError(
            f"the pose graph of {problem.count} poses and {len(problem.i)} edges has no unique solution "
            f"({str(error).strip().splitlines()[0]}); look for information matrices that are far too large or too small"
        ) from error
    before, after = to_transforms(initial, problem.count), to_transforms(optimum, problem.count)
    return IsotropicSolution(
        T=T[0] * after[0].inv() * after,
        cost_before=problem.cost(before),
        cost_after=problem.cost(after),
        iterations=optimizer.iterations(),
        converged=optimizer.iterations() < _MOST_ITERATIONS,
    )


def _factors(problem: ChordalProblem) -> gtsam.NonlinearFactorGraph:
    """F, doubled: GTSAM's cost has a factor 1/2.

    Of GTSAM's two Frobenius factors this one, of T_i^-1 T_j - T_i_j, has a residual that does not turn where all poses
    do. The other's, T_j - T_i T_i_j, does, so that Gauss-Newton steps are far too short along wide, gentle bends of the
    graph: 30 iterations in place of 5 for sphere2500.
    """
    factors = gtsam.NonlinearFactorGraph()
    weights = np.column_stack(
        [np.repeat(problem.kappa[:, None], 12, axis=1), np.repeat(problem.tau[:, None], 4, axis=1)]
    )
    weights[:, _IDLE] = 1.0
    for i, j, T_i_j, weight in zip(problem.i.tolist(), problem.j.tolist(), _measured(problem), weights, strict=True):
        noise = gtsam.noiseModel.Diagonal.Precisions(weight)
        factors.add(gtsam.FrobeniusBetweenFactorNLPose3(i, j, T_i_j, noise))
    return factors


def _chordal(problem: ChordalProblem, T: RigidTransform) -> gtsam.Values:
    """Near a turn R_j = R_i R_ij the chord is 2 sin(angle / 2) sqrt(2): kappa of F is 2 kappa of the angle."""
    between = gtsam.NonlinearFactorGraph()
    precisions = np.column_stack([np.repeat(weight[:, None], 3, axis=1) for weight in (2 * problem.kappa, problem.tau)])
    for i, j, T_i_j, weight in zip(problem.i.tolist(), problem.j.tolist(), _measured(problem), precisions, strict=True):
        between.add(gtsam.BetweenFactorPose3(i, j, T_i_j, gtsam.noiseModel.Diagonal.Precisions(weight)))
    between.add(gtsam.PriorFactorPose3(0, to_pose3(T[0]), gtsam.noiseModel.Isotropic.Sigma(6, START_SIGMA)))
    return to_values(chordal_start(between, problem.count))


def _measured(problem: ChordalProblem) -> list[gtsam.Pose3]:
    return [gtsam.Pose3(gtsam.Rot3(R), t) for R, t in zip(problem.R, problem.t, strict=True)]
