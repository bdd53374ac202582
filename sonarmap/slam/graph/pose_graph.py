"""Poses and the edges between them, optimized by GTSAM.

Conventions are GTSAM's own (docs/conventions.md): tangents rotation first, perturbations on the right, so
that covariances go over unchanged.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import gtsam
import numpy as np
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.factors import edge_factors, gauge_factors, residuals_of
from sonarmap.slam.graph.gauge import Gauge
from sonarmap.slam.graph.gtsam_poses import START_SIGMA, chordal_start, to_transforms, to_values
from sonarmap.slam.graph.known_pose import GAUGE_SIGMA, KnownPose
from sonarmap.slam.graph.marginals import Marginals, information_of, marginals, require_unique
from sonarmap.slam.graph.tangent import adjoint, lengths, propagated
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior


@dataclass(frozen=True)  # without slots: properties are cached
class PoseGraph:
    """An initial estimate of poses, and the measurements to optimize it by.

    Its `gauge` fixes it in the world.

    Attributes:
        trajectory: the initial estimate of N poses.
        edges: measurements; their covariances are used in full and as they are.
        fixed: poses held at their initial estimate.
        priors: (pose, instruments' prior); the trajectory is in their world (`place_in_world`).
        known: other priors of single poses, as from a file.
        control: control points; the trajectory is in their world (`place_by_control`).
    """

    trajectory: Trajectory
    edges: tuple[Edge, ...]
    fixed: tuple[int, ...] = ()
    priors: tuple[tuple[int, PosePrior], ...] = ()
    known: tuple[KnownPose, ...] = ()
    control: tuple[ControlPoint, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.trajectory)
        for edge in self.edges:
            if max(edge.i, edge.j) >= count:
                raise InputError(f"{edge.name} names a pose which is not among the {count} of the trajectory")
        if any(not 0 <= pose < count for pose in self.fixed):
            raise InputError(f"fixed poses {self.fixed}: wanted indices below {count}, the number of poses")
        if any(not 0 <= pose < count for pose in self.gauge.measured):
            raise InputError(f"a prior or control point names a pose which is not among the {count} of the trajectory")

    @cached_property
    def gauge(self) -> Gauge:
        T = self.trajectory.T_world_sensor
        return Gauge(T, self.edges, self.fixed, dict(self.priors), self.known, self.control)

    @property
    def components(self) -> tuple[tuple[int, ...], ...]:
        """Sets of poses that share a frame, in the order of their first poses."""
        return self.gauge.components

    @property
    def anchors(self) -> tuple[int, ...]:
        """Poses that are held: the fixed ones, and the first of each component that nothing else fixes."""
        return self.gauge.anchors

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals of all measurements, in sigmas, at the trajectory as it is."""
        return 2 * factors_of(self).error(to_values(self.trajectory.T_world_sensor))

    def at(self, T_world_sensor: RigidTransform) -> "PoseGraph":
        return replace(self, trajectory=Trajectory(self.trajectory.stamps, T_world_sensor))

    def keep(self, chosen: np.ndarray) -> "PoseGraph":
        """The graph with only the edges that `chosen`, (E,) bool, selects."""
        kept = tuple(edge for edge, take in zip(self.edges, chosen, strict=True) if take)
        return replace(self, edges=kept)

    @property
    def registered_alone(self) -> "PoseGraph":
        return replace(
            self, edges=tuple(edge for edge in self.edges if edge.is_registered), priors=(), known=(), control=()
        )

    def scaled(self, factor: float) -> "PoseGraph":
        """The graph with the covariances of all registrations multiplied (`Edge.scaled`)."""
        return replace(self, edges=tuple(edge.scaled(factor) if edge.is_registered else edge for edge in self.edges))

    def with_scale_factors(self, factors: np.ndarray) -> "PoseGraph":
        """The graph with the covariances of its E edges multiplied by (E,) factors (`Edge.with_scale_factor`)."""
        edges = [edge.with_scale_factor(factor) for edge, factor in zip(self.edges, factors.tolist(), strict=True)]
        return replace(self, edges=tuple(edges))

    def residuals(self) -> np.ndarray:
        """(E,) float64, each edge's residual at the trajectory as it is, in sigmas."""
        return residuals_of(self.edges, self.trajectory.T_world_sensor)

    def from_edges(self) -> "PoseGraph":
        """The same graph with an initial estimate from its edges alone (`chordal_start`); anchors stay.

        Raises:
            InputError: the edges do not determine every pose.
        """
        try:
            without = replace(self, priors=(), known=(), control=())
            started = chordal_start(factors_of(without, START_SIGMA), len(self.trajectory))
        except RuntimeError as error:
            raise self.unsolvable(error) from error
        return self.placed_at(started)

    def placed_at(self, T_world_sensor: RigidTransform) -> "PoseGraph":
        """The graph at these N poses, each connected set moved rigidly so that its anchors stay where they are.

        A set without anchors is moved so that its first measured pose stays where it is.
        """
        initial, matrices = self.trajectory.T_world_sensor, T_world_sensor.as_matrix()
        anchors, measured = self.anchors, self.gauge.measured
        for members in components(len(self.trajectory), self.edges):
            inside = sorted(set(anchors).intersection(members)) or sorted(measured.intersection(members))[:1]
            if inside:
                moved: RigidTransform = (
                    initial[inside[0]] * T_world_sensor[inside[0]].inv() * T_world_sensor[list(members)]
                )
                matrices[list(members)] = moved.as_matrix()
                matrices[inside] = initial[inside].as_matrix()
        return self.at(RigidTransform.from_matrix(matrices))

    def unsolvable(self, error: RuntimeError) -> InputError:
        """The error to raise where GTSAM cannot solve for the poses."""
        return InputError(
            f"the pose graph of {len(self.trajectory)} poses and {len(self.edges)} edges has no unique "
            f"solution ({str(error).strip().splitlines()[0]}); look for covariances that are far too "
            "large or too small"
        )

    def optimize(self, max_iterations: int = 100, covariances: bool = True) -> "Solution":
        """The poses of least squared residual, by Levenberg-Marquardt from the initial estimate.

        Args:
            covariances: whether the solution has these, which needs a unique optimum; poses and residuals do not.

        Raises:
            InputError: the equations have no unique or no finite solution.
        """
        factors, initial = factors_of(self), to_values(self.trajectory.T_world_sensor)
        options = gtsam.LevenbergMarquardtParams()
        options.setMaxIterations(max_iterations)
        if len({pose for edge in self.edges if edge.i != edge.j for pose in (edge.i, edge.j)}) == len(self.trajectory):
            # a third faster than GTSAM's default for 50,000 poses; METIS fails where a pose has no edge
            options.setOrderingType("METIS")
        options.setRelativeErrorTol(1e-9)
        options.setAbsoluteErrorTol(1e-9)
        try:
            optimizer = gtsam.LevenbergMarquardtOptimizer(factors, initial, options)
            optimum = optimizer.optimize()
            linear = factors.linearize(optimum) if covariances else None
            if linear is not None:
                require_unique(linear)
        except RuntimeError as error:
            raise self.unsolvable(error) from error
        return Solution(
            graph=self.at(to_transforms(optimum, len(self.trajectory))),
            chi_squared_before=2 * factors.error(initial),
            chi_squared_after=2 * factors.error(optimum),
            degrees_of_freedom=self.gauge.degrees_of_freedom,
            iterations=optimizer.iterations(),
            converged=optimizer.iterations() < max_iterations,
            residuals=np.array([np.sqrt(2 * factors.at(k).error(optimum)) for k in range(len(self.edges))]),
            _linear=linear,
        )


@dataclass(frozen=True, slots=True)
class Solution:
    """An optimized pose graph.

    Attributes:
        graph: the same edges, with the optimized trajectory.
        chi_squared_before, chi_squared_after: sum of squared residuals in sigmas, at the initial estimate
            and at the optimum; of a good graph the latter is about `degrees_of_freedom`.
        degrees_of_freedom: measured numbers minus unknowns.
        iterations, converged: the optimizer's iterations, and whether they ended before the limit.
        residuals: (E,) float64, each edge's residual in sigmas (the Mahalanobis length of its six numbers).
    """

    graph: PoseGraph
    chi_squared_before: float
    chi_squared_after: float
    degrees_of_freedom: int
    iterations: int
    converged: bool
    residuals: np.ndarray
    _linear: gtsam.GaussianFactorGraph | None

    def __repr__(self) -> str:
        poses, edges = counted(len(self.trajectory), "pose"), counted(len(self.graph.edges), "edge")
        rest = "" if self.converged else ", not converged"
        return (
            f"<Solution of {poses} and {edges}: chi-squared {self.chi_squared_before:.4g} before, "
            f"{self.chi_squared_after:.4g} after {counted(self.iterations, 'iteration')}{rest}, "
            f"{counted(self.degrees_of_freedom, 'degree')} of freedom>"
        )

    @property
    def trajectory(self) -> Trajectory:
        return self.graph.trajectory

    def with_covariances(self) -> "Solution":
        """The solution with covariances, if `optimize` left them out."""
        return replace(self, _linear=factors_of(self.graph).linearize(to_values(self.trajectory.T_world_sensor)))

    def covariances(self) -> np.ndarray:
        """(N, 6, 6) covariance of each pose, rotation first [rad, m], body tangent, relative to its anchor."""
        return self._marginals(np.empty((0, 2), np.intp)).single

    def information(self) -> sparse.csc_array:
        """(6 N, 6 N) information about all poses, six rows each: body tangents, rotation first."""
        assert self._linear is not None, "optimized without covariances"
        return information_of(self._linear, len(self.trajectory))

    def relative(self, i: int, j: int) -> tuple[RigidTransform, np.ndarray]:
        """T_i_j as the graph estimates it, and its (6, 6) covariance: `relatives` of one pair."""
        T, covariances = self.relatives(np.array([[i, j]]))
        return T[0], covariances[0]

    def relatives(self, pairs: np.ndarray) -> tuple[RigidTransform, np.ndarray]:
        """T_i_j of m pairs as the graph estimates them, and their (m, 6, 6) covariances, from the joint marginals.

        With T_i Exp(a) and T_j Exp(b) the relative pose is T_i_j Exp(b - Ad(T_j_i) a), to first order.

        Args:
            pairs: (m, 2) int, different poses i and j of one component each.

        Raises:
            InputError: the covariances are so small that the equations cannot be solved.
        """
        if not len(pairs):
            return RigidTransform.from_matrix(np.empty((0, 4, 4))), np.empty((0, 6, 6))
        i, j = pairs.T
        T = self.trajectory.T_world_sensor
        T_i_j: RigidTransform = T[i].inv() * T[j]
        joint, A = self._marginals(pairs), adjoint(T_i_j.inv())
        shared = A @ joint.across
        covariances = joint.single[j] + A @ joint.single[i] @ A.swapaxes(1, 2) - shared - shared.swapaxes(1, 2)
        return T_i_j, covariances

    def distances(self, pairs: np.ndarray, registrations: Sequence[Registration], most: float = np.inf) -> np.ndarray:
        """(m,) Mahalanobis distances of registrations that are no edges from the poses of their pairs, (m, 2) int,
        under the covariances of both [sigmas]; NaN across components.

        A distance that surely exceeds `most` is infinite, which saves most of the time for thousands of pairs.
        """
        part = np.empty(len(self.trajectory), np.intp)
        for number, members in enumerate(self.graph.components):
            part[list(members)] = number
        sigmas, joined = np.full(len(pairs), np.nan), (part[pairs[:, 0]] == part[pairs[:, 1]])
        if not joined.any():
            return sigmas
        i, j = pairs[joined].T
        T = self.trajectory.T_world_sensor
        comparable = [each for each, is_joined in zip(registrations, joined, strict=True) if is_joined]
        T_i_j: RigidTransform = T[i].inv() * T[j]
        xi: np.ndarray = (
            T_i_j.inv() * RigidTransform.concatenate([each.T_target_source for each in comparable])
        ).as_exp_coords()
        stated = np.stack([each.covariance for each in comparable])
        near = np.ones(len(comparable), bool)
        if np.isfinite(most):
            # whatever the correlation of two errors, the covariance of their sum is at most twice the sum of theirs
            single = self.covariances()
            near = lengths(xi, stated + 2 * (single[j] + propagated(T_i_j.inv(), single[i]))) <= most
        distances = np.full(len(comparable), np.inf)
        distances[near] = lengths(xi[near], stated[near] + self.relatives(pairs[joined][near])[1])
        sigmas[joined] = distances
        return sigmas

    def _marginals(self, pairs: np.ndarray) -> Marginals:
        assert self._linear is not None, "optimized without covariances"
        try:
            return marginals(self._linear, pairs)
        except RuntimeError as error:
            raise self.graph.unsolvable(error) from error


def factors_of(graph: PoseGraph, gauge_sigma: float = GAUGE_SIGMA) -> gtsam.NonlinearFactorGraph:
    """The graph as GTSAM's factors: one for each edge, in their order, then those of single poses (`gauge_factors`).

    Args:
        graph: its poses are keys 0..N-1.
        gauge_sigma: standard deviation of the anchors [rad, m].
    """
    factors = gtsam.NonlinearFactorGraph()
    for factor in (*edge_factors(graph.edges), *gauge_factors(graph.gauge, gauge_sigma)):
        factors.add(factor)
    return factors
