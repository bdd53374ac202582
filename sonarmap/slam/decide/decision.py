"""From everything that was registered to one estimate: which answers become edges, and why the others do not."""

from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.chains import chain_parts
from sonarmap.slam.decide.consistency import Comparison, compare
from sonarmap.slam.decide.hand import hand_edges
from sonarmap.slam.decide.lone import without_lone_steps
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.possible_edge import PossibleEdge, possible_edges
from sonarmap.slam.decide.robust import robust_optimize
from sonarmap.slam.decide.verdict import with_verdicts
from sonarmap.slam.decide.wrong_control import WrongControl, without_wrong_control
from sonarmap.slam.decide.wrong_measurements import JudgedFixes, judge_fixes
from sonarmap.slam.graph.control import ControlPoint, MeasuredControl
from sonarmap.slam.graph.edge import Edge, components, spanning_tree
from sonarmap.slam.graph.place import place_by_control, place_in_world
from sonarmap.slam.graph.pose_covariance import weighed
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.slam.pair import Pair, RegisteredPair
from sonarmap.spectral.result import Registration

# What the optimizer grants each edge while it decides, as a share of the floor that a cycle is granted: errors that no
# covariance knows, such as those of scans that are bent themselves.
_GRAPH_FLOOR = 0.2
# So often a graph with priors is optimized again from its optimum: then it moves by less than a micrometer.
_SETTLING = 3


@dataclass(frozen=True, slots=True)
class Decision:
    """What a survey's registrations amount to."""

    chained: Trajectory  # N poses from the trusted edges alone, without a loop
    solution: Solution  # the optimized graph of the edges that were kept
    pairs: tuple[Pair, ...]  # every pair with its verdict, in the order in which they were given
    fixes: JudgedFixes = field(default_factory=lambda: JudgedFixes({}))  # what instruments measured, as it took part
    wrong_control: tuple[WrongControl, ...] = ()  # control points that all others contradict; they were left out
    drifts: float = 1.0  # how many times more than stated dead reckoning drifts
    # scans of pairs that are kept without ties and control points, and refused for these
    displaced: tuple[tuple[int, int], ...] = ()
    interpolated: tuple[int, ...] = ()  # scans of a stream that no registration holds

    @property
    def understated(self) -> dict[str, float]:
        """By kind of measurement, how many times larger than stated its errors are; those alone where they are."""
        return dict(self.fixes.understated) | ({"odometry": self.drifts} if self.drifts > 1 else {})

    def points(self, control: Sequence[ControlPoint]) -> tuple[MeasuredControl, ...]:
        """Where the poses have control points, those to check with among them."""
        graph, wrong = self.solution.graph, {id(each.point): each.sigmas for each in self.wrong_control}
        placed = {k for members in graph.components if graph.gauge.lies_in_world(members) for k in members}
        T = graph.trajectory.T_world_sensor
        return tuple(
            MeasuredControl(
                point, T[point.scan].apply(point.point), point.scan in placed, wrong.get(id(point), float("nan"))
            )
            for point in control
        )


def decide(
    pairs: Sequence[RegisteredPair], measurements: Measurements, voxel: float, settings: LoopSettings
) -> Decision:
    """Decide about every answer of every pair, and optimize.

    Accepted registrations of consecutive scans are chained. All other answers, alternatives and refused ones among
    them, have to agree with the chain or with one another; those that join parts of the chain come first. What is left
    is optimized robustly, so that an answer that the others contradict, one of the chain too, is left out. What a
    person accepted or added is an edge in any case, what a person rejected is none. A step that is not sure, and that
    no pair across confirms, is a gap, where no dead reckoning tells of it. The voxel is the survey's [m].
    """
    pairs = without_lone_steps(pairs, {*measurements.ties, *((edge.i, edge.j) for edge in measurements.steps)})
    distrusted: set[tuple[int, int]] = set()
    while True:
        decision, contradicted = _decide(pairs, measurements, settings.floor(voxel), settings.bound, distrusted)
        if not contradicted:
            return decision
        distrusted |= contradicted


def _decide(
    pairs: Sequence[RegisteredPair],
    measurements: Measurements,
    floor: np.ndarray,
    bound: float,
    distrusted: Set[tuple[int, int]],
) -> tuple[Decision, set[tuple[int, int]]]:
    """As `decide` with `distrusted` pairs kept out of the chain; and which of the chain the graph contradicts."""
    count, odometry, priors = len(measurements.scans), measurements.steps, measurements.priors
    possible = _Possible.of(pairs, measurements, floor, bound, distrusted)
    edges = (*possible.trusted, *(answer.edge() for answer in possible.taken.values()), *odometry)
    sure = [*possible.trusted, *odometry, *possible.joins]
    parts = components(count, sure)
    chained = place_in_world(chain(sure, measurements.stamps), parts, priors)
    chained = place_by_control(chained, parts, measurements.control, priors)
    fixes = _widened(PoseGraph(chained, tuple(sure)), _GRAPH_FLOOR * floor)
    judged = judge_fixes(fixes, priors)
    measured = tuple(sorted(judged.priors.items()))
    holding = tuple(point for point in measurements.control if point.holds)
    control, wrong_control = without_wrong_control(replace(fixes, priors=measured, control=holding))
    graph = PoseGraph(chained, edges, priors=measured, control=control)
    robust = robust_optimize(_widened(graph, _GRAPH_FLOOR * floor), trust_chain=False)
    kept_graph = weighed(graph.keep(robust.accepted).at(robust.solution.trajectory.T_world_sensor))
    # now that loops tell where the poses are, smaller mistakes show, and errors that all fixes share
    judged = judge_fixes(kept_graph, priors)
    kept_graph = replace(kept_graph, priors=tuple(sorted(judged.priors.items())))
    control, more_wrong = without_wrong_control(kept_graph)
    kept_graph = replace(kept_graph, control=control)
    solution = _settled(kept_graph)
    solution = replace(solution, chi_squared_before=kept_graph.at(chained.T_world_sensor).chi_squared)
    kept = {(edge.i, edge.j) for edge in solution.graph.edges if edge.is_of_pair}
    decided = with_verdicts(pairs, measurements.ties, possible.supported, possible.taken, solution)
    drifts = 1.0 if measurements.odometry is None else measurements.odometry.understated
    decision = Decision(chained, solution, tuple(decided), judged, (*wrong_control, *more_wrong), drifts)
    return decision, possible.chain_scans - kept


def _settled(graph: PoseGraph) -> Solution:
    """The optimum; what is not measured is taken from where the optimizer starts: let it be the optimum itself."""
    solution = graph.optimize()
    for _ in range(_SETTLING if graph.priors or graph.control else 0):
        solution = solution.graph.optimize()
    return solution


@dataclass(frozen=True, slots=True)
class _Possible:
    """What may become an edge, before the graph is optimized."""

    trusted: list[Edge]  # the edges of the chain, and what a person accepted or added
    joins: list[Edge]  # answers that join parts of these
    # all answers that are given to the optimizer beside `trusted`, by their scans
    taken: dict[tuple[int, int], PossibleEdge]
    supported: list[PossibleEdge]  # all answers but those of the chain, with their support
    chain_scans: set[tuple[int, int]]  # the scans of the edges of the chain

    @classmethod
    def of(
        cls,
        pairs: Sequence[RegisteredPair],
        measurements: Measurements,
        floor: np.ndarray,
        bound: float,
        distrusted: Set[tuple[int, int]],
    ) -> "_Possible":
        count, odometry, ties = len(measurements.scans), measurements.steps, measurements.ties

        def compared_with(known: Sequence[Edge]) -> Comparison:
            return compare(chain_parts(count, [*known, *odometry]), answers, floor, bound)

        asked = [p for p in pairs if p.scans not in ties or ties[p.scans].verdict != "reject"]
        trusted = [edge for pair in asked if pair.scans not in distrusted and (edge := _chain_edge(pair))]
        chain_scans = {(edge.i, edge.j) for edge in trusted}
        answers = [
            answer
            for pair in asked
            if pair.scans not in chain_scans
            for answer in possible_edges(pair)
            if not answer.fault
        ]
        supported = compared_with(trusted).support(answers)
        by_itself = {scans: answer.registration for scans, answer in _taken(supported).items()}
        by_hand = hand_edges(asked, ties, by_itself)
        if by_hand:
            trusted = [*(edge for edge in trusted if (edge.i, edge.j) not in by_hand), *by_hand.values()]
            supported = compared_with(trusted).support(answers)
        joins: list[Edge] = []
        while new_joins := _joins(count, [*trusted, *odometry, *joins], supported):
            joins += new_joins
            supported = compared_with([*trusted, *joins]).support(answers)
        taken = {scans: answer for scans, answer in _taken(supported).items() if scans not in by_hand}
        return cls(trusted, joins, taken, supported, chain_scans)


def _widened(graph: PoseGraph, floor: np.ndarray) -> PoseGraph:
    """The graph with (6,) standard deviations added to each registration's."""

    def widened(registration: Registration) -> Registration:
        covariance = registration.covariance + np.diag(floor**2)
        return replace(registration, covariance=covariance, T_by_scans=None, covariance_by_scans=None)

    return replace(
        graph,
        edges=tuple(replace(e, registration=widened(e.registration)) if e.is_registered else e for e in graph.edges),
    )


def _chain_edge(pair: RegisteredPair) -> Edge | None:
    """The pair's edge of the chain: of consecutive scans whose registration is accepted."""
    if pair.role != "sequential" or pair.registration is None or not pair.accepted:
        return None
    try:
        return Edge(pair.i, pair.j, pair.registration, "sequential")
    except InputError:
        return None


def _joins(count: int, trusted: Sequence[Edge], supported: Sequence[PossibleEdge]) -> list[Edge]:
    """Answers that join parts of the chain, as few as suffice, the best supported first."""
    joining = [possible for possible in supported if possible.joins_parts and possible.may_join]
    joining.sort(key=lambda possible: (-possible.support.pairs, -possible.weight, *possible.scans))
    edges = [possible.edge() for possible in joining]
    tree = {id(edge) for edge in spanning_tree(count, [*trusted, *edges])}
    return [edge for edge in edges if id(edge) in tree]


def _taken(supported: Sequence[PossibleEdge]) -> dict[tuple[int, int], PossibleEdge]:
    """At most one answer of every pair, the best supported, by the pair's scans."""

    def standing(possible: PossibleEdge) -> tuple[bool, int, float]:
        return possible.support.agrees, possible.support.pairs, possible.weight

    taken: dict[tuple[int, int], PossibleEdge] = {}
    for possible in supported:
        if possible.may_be_taken:
            taken[possible.scans] = max(taken.get(possible.scans, possible), possible, key=standing)
    return taken
