"""Optimization of a pose graph from a file, and the quality of the result, for `sonarmap optimize`."""

import time
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.robust import robust_optimize
from sonarmap.slam.graph.edge import spanning_tree
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.optimize.certificate import Certificate, certify
from sonarmap.slam.optimize.chordal import ChordalProblem, optimize_isotropic

Objective = Literal["full", "isotropic"]
Start = Literal["chordal", "given"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)
STARTS: tuple[Start, ...] = get_args(Start)

_MIN_STRAIN = 1e-3  # largest residual in the spanning tree below which loops have no effect [sigmas]
_MIN_DECREASE = 1e-6  # relative decrease of the cost below which the poses were optimal before


@dataclass(frozen=True, slots=True)
class Optimized:
    """An optimized pose graph.

    Attributes:
        objective, start: what was minimized, and from where.
        given: the graph as it was given, E edges.
        accepted: (E,) bool, which edges are used; all without outlier rejection.
        reasons: (E,) why each edge was accepted or rejected; empty without outlier rejection.
        graph: the accepted edges with the optimized poses.
        residuals_before, residuals_after: (E,) float64, of all given edges, at the given and at the optimized poses, in
            sigmas of their whole covariances.
        cost_before, cost_after: of the accepted edges at the given and at the optimized poses, without a unit: F of the
            isotropic objective (`slam.optimize.chordal`), half of chi-squared of the full one.
        iterations, converged: the optimizer's iterations, and whether they ended before the limit.
        certificate: of the isotropic objective; None with the full one, which has none.
        seconds: duration of each stage [s].
    """

    objective: Objective
    start: Start
    given: PoseGraph
    accepted: np.ndarray
    reasons: tuple[str, ...]
    graph: PoseGraph
    residuals_before: np.ndarray
    residuals_after: np.ndarray
    cost_before: float
    cost_after: float
    iterations: int
    converged: bool
    certificate: Certificate | None
    seconds: dict[str, float] = field(default_factory=dict[str, float])

    def __str__(self) -> str:
        before, after = self.chi_squared
        return (
            f"{counted(len(self.graph.trajectory), 'pose')}, {int(self.accepted.sum())} of "
            f"{counted(len(self.accepted), 'edge')} accepted, {self.objective} objective\n"
            f"  chi-squared {after:.1f}, {before:.1f} before, of {self.degrees_of_freedom} degrees of freedom\n"
            f"  {'converged' if self.converged else 'NOT CONVERGED'} after {counted(self.iterations, 'iteration')}"
        )

    @property
    def chi_squared(self) -> tuple[float, float]:
        """Chi-squared of the accepted edges and all priors, at the given and at the optimized poses."""
        if self.objective == "full":
            return 2 * self.cost_before, 2 * self.cost_after
        return self.given.keep(self.accepted).chi_squared, self.graph.chi_squared

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers minus unknowns."""
        return self.graph.gauge.degrees_of_freedom

    def to_json(self) -> dict[str, Any]:
        """The summary as JSON's types."""
        chi_squared_before, chi_squared_after = self.chi_squared
        return {
            "objective": self.objective,
            "start": self.start,
            "poses": len(self.graph.trajectory),
            "edges": len(self.given.edges),
            "components": len(self.graph.components),
            "cost_before": self.cost_before,
            "cost_after": self.cost_after,
            "chi_squared_before": chi_squared_before,
            "chi_squared_after": chi_squared_after,
            "degrees_of_freedom": self.degrees_of_freedom,
            "iterations": self.iterations,
            "converged": self.converged,
            "certificate": _certificate(self.certificate),
            "loops": self._loops(),
        }

    def _loops(self) -> list[dict[str, Any]]:
        """Every loop and every rejected edge, by the vertices' ids."""
        ids = self.given.trajectory.stamps.astype(np.int64).tolist()
        residuals = self.residuals_after.tolist()
        rows: list[dict[str, Any]] = []
        for k, edge in enumerate(self.given.edges):
            if edge.kind == "loop" or not self.accepted[k]:
                verdict = "accepted" if self.accepted[k] else "rejected"
                entry = {"i": ids[edge.i], "j": ids[edge.j], "kind": edge.kind, "sigmas": residuals[k]}
                reason = {"reason": self.reasons[k]} if self.reasons else {}
                rows.append(entry | {"verdict": verdict} | reason)
        return rows


def optimize(graph: PoseGraph, objective: Objective, start: Start = "chordal", robust: bool = False) -> Optimized:
    """Minimize the cost of a graph.

    Args:
        graph: connected, with at least one edge.
        objective: "full", chi-squared with the edges' whole covariances; "isotropic", F of
            `slam.optimize.chordal`, which has a certificate of global optimality.
        start: "chordal", from the edges alone; or "given", from the graph's poses.
        robust: whether to reject outlier edges first.

    Raises:
        InputError: the objective or start is unknown, the objective does not support what the graph holds, or the
            equations have no unique solution.
    """
    for name, given, choices in (("objective", objective, OBJECTIVES), ("start", start, STARTS)):
        if given not in choices:
            raise InputError(f"`{name}={given!r}` is not known; choose one of {', '.join(choices)}")
    if not graph.edges:
        raise InputError("the graph holds one pose and no edge; there is nothing to optimize")
    clock, seconds = time.perf_counter, {}
    accepted, reasons = np.ones(len(graph.edges), bool), ()
    begun = clock()
    if robust:
        robust_result = robust_optimize(graph)
        accepted, reasons = robust_result.accepted, robust_result.reasons
        seconds["reject"] = clock() - begun
    kept, begun = graph.keep(accepted), clock()
    solved, before, after, iterations, converged = _SOLVERS[objective](kept, start)
    seconds["optimize"] = clock() - begun
    certificate, begun = None, clock()
    if objective == "isotropic":
        problem = ChordalProblem.of(len(kept.trajectory), kept.edges)
        certificate = certify(problem, solved.trajectory.T_world_sensor)
        seconds["certify"] = clock() - begun
    return Optimized(
        objective=objective,
        start=start,
        given=graph,
        accepted=accepted,
        reasons=reasons,
        graph=solved,
        residuals_before=graph.residuals(),
        residuals_after=graph.at(solved.trajectory.T_world_sensor).residuals(),
        cost_before=before,
        cost_after=after,
        iterations=iterations,
        converged=converged,
        certificate=certificate,
        seconds=seconds,
    )


_Solved = tuple[PoseGraph, float, float, int, bool]


def _full(graph: PoseGraph, start: Start) -> _Solved:
    solution = (graph.from_edges() if start == "chordal" else graph).optimize()
    before = graph.chi_squared / 2
    return solution.graph, before, solution.chi_squared_after / 2, solution.iterations, solution.converged


def _isotropic(graph: PoseGraph, start: Start) -> _Solved:
    if graph.known or graph.control:
        raise InputError(
            "the file holds priors of single vertices or control points, and the isotropic objective takes only edges "
            "between vertices; use `objective=full`"
        )
    if len(graph.fixed) > 1:
        raise InputError(
            f"{len(graph.fixed)} vertices are fixed, and the isotropic objective can hold one; use `objective=full`, "
            "or leave out all FIX lines but one"
        )
    problem, T = ChordalProblem.of(len(graph.trajectory), graph.edges), graph.trajectory.T_world_sensor
    solution = optimize_isotropic(problem, T, start)
    held = graph.fixed[0] if graph.fixed else 0
    moved: RigidTransform = T[held] * solution.T[held].inv() * solution.T
    return graph.at(moved), problem.cost(T), solution.cost_after, solution.iterations, solution.converged


_SOLVERS = {"full": _full, "isotropic": _isotropic}


def distance_to_other(optimized: Optimized) -> dict[str, Any]:
    """Distance to the other objective's optimum of the same edges, as JSON's types, or why there is none.

    Root mean squares and maxima over the poses, with the first poses aligned.
    """
    other: Objective = "full" if optimized.objective == "isotropic" else "isotropic"
    try:
        solved = _SOLVERS[other](optimized.given.keep(optimized.accepted), optimized.start)[0]
    except InputError as error:
        return {"to": other, "reason": str(error)}
    T, T_other = (T[0].inv() * T for T in (optimized.graph.trajectory.T_world_sensor, solved.trajectory.T_world_sensor))
    degrees = np.degrees((T.rotation.inv() * T_other.rotation).magnitude())
    meters = np.linalg.norm(T.translation - T_other.translation, axis=1)
    return {
        "to": other,
        "rotation_rms_deg": _rms(degrees),
        "rotation_max_deg": float(degrees.max()),
        "translation_rms_m": _rms(meters),
        "translation_max_m": float(meters.max()),
    }


def without_effect(optimized: Optimized) -> str:
    """Why the optimization had no effect, in words; "" if it had one."""
    graph = optimized.graph
    residuals = optimized.residuals_after[optimized.accepted]
    in_tree = {id(edge) for edge in spanning_tree(len(graph.trajectory), graph.edges)}
    tree_residuals = residuals[[k for k, edge in enumerate(graph.edges) if id(edge) in in_tree]]
    loops = len(graph.edges) - len(tree_residuals)
    if not loops:
        return "the graph has no loop: its poses follow from its edges one after another, and nothing corrects them"
    if tree_residuals.max(initial=0) < _MIN_STRAIN:
        return (
            f"the {loops} edges that close loops change nothing: all other residuals are at most "
            f"{tree_residuals.max():.1g} sigmas. Either they weigh nothing beside the others, or they agree with "
            "them to the last digit, as copies do; look at their information matrices"
        )
    before, after = optimized.cost_before, optimized.cost_after
    if before - after <= _MIN_DECREASE * after:
        return f"the cost did not fall ({before:.9g} before, {after:.9g} after): the poses were optimal as they were"
    return ""


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def _certificate(certificate: Certificate | None) -> dict[str, Any]:
    """The certificate as JSON's types; NaN and infinity become null."""
    if certificate is None:
        reason = "only the isotropic objective has a certificate; use `objective=isotropic`"
        return {"verdict": "none", "gap": None, "lowest": None, "cost": None, "reason": reason}
    values = asdict(certificate)
    return {name: value if isinstance(value, str) or np.isfinite(value) else None for name, value in values.items()}
