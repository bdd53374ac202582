"""Optimization of a pose graph from a file, and the quality of the result, for `sonarmap optimize`."""

import time
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.robust import robust_optimize
from sonarmap.slam.graph.pose_graph import PoseGraph

Start = Literal["chordal", "given"]
STARTS: tuple[Start, ...] = get_args(Start)


@dataclass(frozen=True, slots=True)
class Optimized:
    """An optimized pose graph.

    Attributes:
        start: of the poses, "chordal" or "given".
        given: the graph as it was given, E edges.
        accepted: (E,) bool, which edges are used; all without outlier rejection.
        reasons: (E,) why each edge was accepted or rejected; empty without outlier rejection.
        graph: the accepted edges with the optimized poses.
        residuals_before, residuals_after: (E,) float64, of all given edges, at the given and at the optimized poses, in
            sigmas of their whole covariances.
        chi_squared_before, chi_squared_after: of the accepted edges and all priors, at the given and at the optimized
            poses.
        iterations, converged: the optimizer's iterations, and whether they ended before the limit.
        seconds: duration of each stage [s].
    """

    start: Start
    given: PoseGraph
    accepted: np.ndarray
    reasons: tuple[str, ...]
    graph: PoseGraph
    residuals_before: np.ndarray
    residuals_after: np.ndarray
    chi_squared_before: float
    chi_squared_after: float
    iterations: int
    converged: bool
    seconds: dict[str, float] = field(default_factory=dict[str, float])

    def __str__(self) -> str:
        return (
            f"{counted(len(self.graph.trajectory), 'pose')}, {int(self.accepted.sum())} of "
            f"{counted(len(self.accepted), 'edge')} accepted\n"
            f"  chi-squared {self.chi_squared_after:.1f}, {self.chi_squared_before:.1f} before, of "
            f"{self.degrees_of_freedom} degrees of freedom\n"
            f"  {'converged' if self.converged else 'NOT CONVERGED'} after {counted(self.iterations, 'iteration')}"
        )

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers minus unknowns."""
        return self.graph.gauge.degrees_of_freedom

    def to_json(self) -> dict[str, Any]:
        """The summary as JSON's types."""
        return {
            "start": self.start,
            "poses": len(self.graph.trajectory),
            "edges": len(self.given.edges),
            "components": len(self.graph.components),
            "chi_squared_before": self.chi_squared_before,
            "chi_squared_after": self.chi_squared_after,
            "degrees_of_freedom": self.degrees_of_freedom,
            "iterations": self.iterations,
            "converged": self.converged,
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


def optimize(graph: PoseGraph, start: Start = "chordal", robust: bool = False) -> Optimized:
    """Minimize chi-squared of a graph, with the edges' whole covariances.

    Args:
        graph: connected, with at least one edge.
        start: "chordal", from the edges alone; or "given", from the graph's poses.
        robust: whether to reject outlier edges first.

    Raises:
        InputError: the start is unknown, the graph has no edge, or the equations have no unique solution.
    """
    if start not in STARTS:
        raise InputError(f"`start={start!r}` is not known; choose one of {', '.join(STARTS)}")
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
    solution = (kept.from_edges() if start == "chordal" else kept).optimize()
    seconds["optimize"] = clock() - begun
    return Optimized(
        start=start,
        given=graph,
        accepted=accepted,
        reasons=reasons,
        graph=solution.graph,
        residuals_before=graph.residuals(),
        residuals_after=graph.at(solution.trajectory.T_world_sensor).residuals(),
        chi_squared_before=kept.chi_squared,
        chi_squared_after=solution.chi_squared_after,
        iterations=solution.iterations,
        converged=solution.converged,
        seconds=seconds,
    )
