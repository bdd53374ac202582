# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Poses and the edges between them, optimized by GTSAM.

Conventions are GTSAM's own (docs/conventions.md): tangents rotation first, perturbations on the right, so
that covariances go over unchanged.
"""

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from slam.graph.edge import Edge, components, inverse_definite
from slam.graph.gtsam_poses import START_SIGMA, chordal_start, to_pose3, to_transforms, to_values
from slam.graph.known_pose import GAUGE_SIGMA, KnownPose, undetermined
from slam.graph.measured_poses import gauge, known_poses, level, unmeasured
from slam.graph.trajectory import Trajectory
from spectral.result import Registration
from spectral.scan import PosePrior

# Translations of an edge are held by standard deviations no farther apart than this.
_SPREAD = 1000.0


@dataclass(frozen=True, slots=True)
class PoseGraph:
    """An estimate and the measurements it has to agree with.

    Attributes:
        trajectory: the initial estimate of N poses.
        edges: measurements; their covariances are used in full and as they are.
        fixed: poses held at their initial estimate.
        priors: (pose, what instruments measured of it); the trajectory is in their world (`place_in_world`).
        known: what else is known of single poses, as a file says it.

    Every connected component needs a tie to the world: its fixed poses or its priors are that tie, and where it has
    neither, its first pose is held (`anchors`). What no instrument measures of any of its poses is held there too.

    Raises:
        InputError: an edge or a fixed pose that names a pose which is not there.
    """

    trajectory: Trajectory
    edges: tuple[Edge, ...]
    fixed: tuple[int, ...] = ()
    priors: tuple[tuple[int, PosePrior], ...] = ()
    known: tuple[KnownPose, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.trajectory)
        for edge in self.edges:
            if max(edge.i, edge.j) >= count:
                raise InputError(f"{edge.name} names a pose which is not among the {count} of the trajectory")
        if any(not 0 <= pose < count for pose in self.fixed):
            raise InputError(f"fixed poses {self.fixed}: wanted indices below {count}, the number of poses")
        if any(not 0 <= pose < count for pose in self._measured):
            raise InputError(f"a prior names a pose which is not among the {count} of the trajectory")

    @property
    def components(self) -> tuple[tuple[int, ...], ...]:
        """The sets of poses that share a frame, in the order of their first poses.

        They are those that edges join; what instruments place wholly in the world shares the world.
        """
        parts = components(len(self.trajectory), self.edges)
        priors = dict(self.priors)
        placed = [self._is_placed(part, priors) for part in parts] if self._measured else []
        if sum(placed) < 2:
            return parts
        world = tuple(sorted(pose for part, known in zip(parts, placed, strict=True) if known for pose in part))
        return tuple(sorted([world, *(part for part, known in zip(parts, placed, strict=True) if not known)]))

    @property
    def in_world(self) -> list[int]:
        """Poses of which instruments tell all six numbers, each by itself."""
        complete = {pose for pose, prior in self.priors if prior.is_complete}
        return sorted(complete.union(known.pose for known in self.known if known.rank == 6))

    @property
    def anchors(self) -> tuple[int, ...]:
        """The poses held where they are: the fixed, and the first of a component that nothing else holds."""
        held = {edge.i for edge in self.edges if edge.kind == "prior"}.union(self.fixed, self._measured)
        first = (members[0] for members in self.components if held.isdisjoint(members))
        return tuple(sorted({*self.fixed, *first}))

    @property
    def loose(self) -> list[tuple[int, np.ndarray]]:
        """The first pose of each component whose priors do not tell all, and (6,) bool what they do not tell."""
        priors = dict(self.priors)
        measured = (members for members in self.components if not set(self.anchors).intersection(members))
        unheld = [
            (members[0], unmeasured(members, priors)) for members in measured if set(priors).intersection(members)
        ]
        return [(pose, free) for pose, free in unheld if free.any()]

    @property
    def all_known(self) -> list[KnownPose]:
        """All that is known of single poses but the anchors': `known`, the priors, and what is held beside these."""
        T = self.trajectory.T_world_sensor
        held = [gauge(pose, free, T[pose]) for pose, free in self.loose]
        return [*self.known, *known_poses(dict(self.priors), T), *self._level, *held, *self._undetermined]

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers less free ones."""
        free = 6 * (len(self.trajectory) - len(self.anchors)) - sum(int(free.sum()) for _, free in self.loose)
        measured = 6 * len(self.edges) + sum(int(np.isfinite(prior.sigmas).sum()) for _, prior in self.priors)
        return measured + sum(known.rank for known in (*self.known, *self._level, *self._undetermined)) - free

    def _is_placed(self, part: tuple[int, ...], priors: dict[int, PosePrior]) -> bool:
        """Whether instruments tell all of where the poses lie that edges join."""
        inside = set(part)
        if not inside.isdisjoint(priors) and not unmeasured(part, priors).any():
            return True
        known = [known for known in self.known if known.pose in inside]
        return bool(known) and undetermined(part, known, self.trajectory.T_world_sensor) is None

    @property
    def _measured(self) -> set[int]:
        """The poses of which something is measured."""
        return {*dict(self.priors), *(known.pose for known in self.known)}

    @property
    def _level(self) -> list[KnownPose]:
        """That vehicles float about level, where no instrument measured attitudes and positions alone tell the tilt."""
        priors, anchors = dict(self.priors), set(self.anchors)
        found = (
            level(members, priors, self.trajectory.T_world_sensor)
            for members in (self.components if priors else ())
            if not anchors.intersection(members)
        )
        return [known for known in found if known is not None]

    @property
    def _undetermined(self) -> list[KnownPose]:
        """What holds components of which `known` tells something, but not all."""
        held = []
        for members in self.components if self.known else ():
            inside = set(members)
            known = [known for known in self.known if known.pose in inside]
            if known and not inside.intersection(self.anchors, dict(self.priors)):
                holds = undetermined(members, known, self.trajectory.T_world_sensor)
                held += [] if holds is None else [holds]
        return held

    @property
    def chi_squared(self) -> float:
        """The sum of the edges' squared residuals in sigmas, at the trajectory as it is."""
        return 2 * factors_of(self).error(to_values(self.trajectory.T_world_sensor))

    def at(self, T_world_sensor: RigidTransform) -> "PoseGraph":
        """The same edges, with these N poses."""
        return replace(self, trajectory=Trajectory(self.trajectory.stamps, T_world_sensor))

    def keep(self, chosen: np.ndarray) -> "PoseGraph":
        """The graph with those of its E edges alone that `chosen`, (E,) bool, says."""
        kept = tuple(edge for edge, take in zip(self.edges, chosen, strict=True) if take)
        return replace(self, edges=kept)

    @property
    def registered_alone(self) -> "PoseGraph":
        """The graph without what instruments say."""
        return replace(self, edges=tuple(edge for edge in self.edges if edge.is_registered), priors=(), known=())

    def scaled(self, factor: float) -> "PoseGraph":
        """The graph with the covariances of all registrations multiplied (`Edge.scaled`)."""
        edges = [edge.scaled(factor) if edge.is_registered else edge for edge in self.edges]
        return replace(self, edges=tuple(edges))

    def doubted(self, factors: np.ndarray) -> "PoseGraph":
        """The graph with the covariances of its E edges multiplied by (E,) factors (`Edge.doubted`)."""
        edges = [edge.doubted(factor) for edge, factor in zip(self.edges, factors.tolist(), strict=True)]
        return replace(self, edges=tuple(edges))

    def residuals(self) -> np.ndarray:
        """(E,) float64, each edge's residual at the trajectory as it is, in sigmas."""
        factors, values = factors_of(self), to_values(self.trajectory.T_world_sensor)
        return _residuals(factors, values, len(self.edges))

    def from_edges(self) -> "PoseGraph":
        """The same graph with an initial estimate that its edges alone tell (`chordal_start`); anchors stay.

        Raises:
            InputError: the edges do not tell every pose.
        """
        try:
            without = replace(self, priors=(), known=())
            started = chordal_start(factors_of(without, START_SIGMA), len(self.trajectory))
        except RuntimeError as error:
            raise self.unsolvable(error) from error
        return self.held(started)

    def held(self, T_world_sensor: RigidTransform) -> "PoseGraph":
        """The same edges with these N poses, what edges join moved as a whole, so that its anchors are where they were.

        A part whose place is measured is moved so that its first measured pose is where it was.
        """
        initial, matrices = self.trajectory.T_world_sensor, T_world_sensor.as_matrix()
        anchors, measured = self.anchors, self._measured
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
        """What to say where GTSAM cannot solve for the poses."""
        return InputError(
            f"the pose graph of {len(self.trajectory)} poses and {len(self.edges)} edges has no unique "
            f"solution ({str(error).strip().splitlines()[0]}); look for covariances that are far too "
            "large or too small"
        )

    def optimize(self, max_iterations: int = 100, covariances: bool = True) -> "Solution":
        """The poses of least squared residual, by Levenberg-Marquardt from the initial estimate.

        Args:
            max_iterations: of the optimizer.
            covariances: whether the solution has these, which takes a unique one; poses and residuals take none.

        Raises:
            InputError: the equations have no unique or no finite solution.
        """
        factors, initial = factors_of(self), to_values(self.trajectory.T_world_sensor)
        options = gtsam.LevenbergMarquardtParams()
        options.setMaxIterations(max_iterations)
        options.setRelativeErrorTol(1e-9)
        options.setAbsoluteErrorTol(1e-9)
        try:
            optimizer = gtsam.LevenbergMarquardtOptimizer(factors, initial, options)
            optimum = optimizer.optimize()
            marginals = gtsam.Marginals(factors, optimum) if covariances else None
        except RuntimeError as error:
            raise self.unsolvable(error) from error
        return Solution(
            graph=self.at(to_transforms(optimum, len(self.trajectory))),
            chi_squared_before=2 * factors.error(initial),
            chi_squared_after=2 * factors.error(optimum),
            degrees_of_freedom=self.degrees_of_freedom,
            iterations=optimizer.iterations(),
            converged=optimizer.iterations() < max_iterations,
            residuals=_residuals(factors, optimum, len(self.edges)),
            _marginals=marginals,
        )


@dataclass(frozen=True, slots=True)
class Solution:
    """An optimized pose graph.

    Attributes:
        graph: the same edges, with the optimized trajectory.
        chi_squared_before, chi_squared_after: sum of squared residuals in sigmas, at the initial estimate
            and at the optimum; of a good graph the latter is about `degrees_of_freedom`.
        degrees_of_freedom: measured numbers less free ones.
        iterations, converged: of the optimizer, and whether it came to rest before the limit.
        residuals: (E,) float64, each edge's residual in sigmas (the Mahalanobis length of its six numbers).
    """

    graph: PoseGraph
    chi_squared_before: float
    chi_squared_after: float
    degrees_of_freedom: int
    iterations: int
    converged: bool
    residuals: np.ndarray
    _marginals: gtsam.Marginals | None

    @property
    def trajectory(self) -> Trajectory:
        """The optimized poses."""
        return self.graph.trajectory

    @property
    def _known(self) -> gtsam.Marginals:
        assert self._marginals is not None, "optimized without covariances"
        return self._marginals

    def covariance(self, k: int) -> np.ndarray:
        """(6, 6) of one pose, as `covariances`."""
        return self._known.marginalCovariance(k)

    def covariances(self) -> np.ndarray:
        """(N, 6, 6): each pose's, rotation first [rad, m], body tangent, against its component's anchor."""
        return np.stack([self.covariance(k) for k in range(len(self.trajectory))])

    def relative(self, i: int, j: int) -> tuple[RigidTransform, np.ndarray]:
        """T_i_j as the graph estimates it, and its (6, 6) covariance, from the joint marginal of both poses.

        With T_i Exp(a) and T_j Exp(b) the relative pose is T_i_j Exp(b - Ad(T_j_i) a), to first order. Both
        poses have to be in one component.

        Raises:
            InputError: covariances so small that the equations cannot be solved for it.
        """
        T = self.trajectory.T_world_sensor
        T_i_j = T[i].inv() * T[j]
        try:
            joint = self._known.jointMarginalCovariance([i, j])
        except RuntimeError as error:
            raise self.graph.unsolvable(error) from error
        stacked = np.block([[joint.at(i, i), joint.at(i, j)], [joint.at(j, i), joint.at(j, j)]])
        jacobian = np.hstack([-to_pose3(T_i_j.inv()).AdjointMap(), np.eye(6)])
        return T_i_j, jacobian @ stacked @ jacobian.T

    def distance(self, i: int, j: int, registration: Registration) -> float:
        """How far a registration that is no edge is from the poses [sigmas], under its covariance and theirs."""
        T_i_j, covariance = self.relative(i, j)
        xi: np.ndarray = (T_i_j.inv() * registration.T_target_source).as_exp_coords()
        return float(np.sqrt(xi @ np.linalg.solve(covariance + registration.covariance, xi)))


def _residuals(factors: gtsam.NonlinearFactorGraph, values: gtsam.Values, count: int) -> np.ndarray:
    """Of the first `count` factors, which are the edges'."""
    return np.array([np.sqrt(2 * factors.at(k).error(values)) for k in range(count)])


def factors_of(graph: PoseGraph, gauge_sigma: float = GAUGE_SIGMA) -> gtsam.NonlinearFactorGraph:
    """The graph as GTSAM's factors: one for each edge, in their order, then those of the anchors and known poses.

    Args:
        graph: its poses are keys 0..N-1.
        gauge_sigma: standard deviation with which anchors are held [rad, m].
    """
    factors = gtsam.NonlinearFactorGraph()
    for edge in graph.edges:
        factors.add(edge_factor(edge))
    held = gtsam.noiseModel.Isotropic.Sigma(6, gauge_sigma)
    T = graph.trajectory.T_world_sensor
    for pose in graph.anchors:
        factors.add(gtsam.PriorFactorPose3(pose, to_pose3(T[pose]), held))
    for known in graph.all_known:
        for factor in known.factors():
            factors.add(factor)
    return factors


def edge_factor(edge: Edge) -> gtsam.NonlinearFactor:
    """What one edge says, for GTSAM."""
    measured = to_pose3(edge.registration.T_target_source)
    noise = gtsam.noiseModel.Gaussian.Covariance(_solvable(edge.registration.covariance))
    if edge.kind == "prior":
        return gtsam.PriorFactorPose3(edge.i, measured, noise)
    return gtsam.BetweenFactorPose3(edge.i, edge.j, measured, noise)


def _solvable(covariance: np.ndarray) -> np.ndarray:
    """(6, 6) that GTSAM can factor; along a bare wall the one direction is hundreds of meters, the others centimeters.

    It takes a pivot 4096 times below its neighbor for none: so what is that loose is held a thousand times less than
    what is held best.
    """
    information = inverse_definite(covariance)
    best = float(np.diag(information)[3:].max())
    if float(np.diag(covariance)[3:].max()) * best <= _SPREAD**2:
        return covariance
    return inverse_definite(information + np.diag(np.repeat([0.0, best / _SPREAD**2], 3)))
