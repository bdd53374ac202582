"""The inference: which hypotheses become edges, why the others do not, and the optimized poses."""

from collections.abc import Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.consistency import Comparison, chain_parts, compare
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.other_place import OtherPlace
from sonarmap.slam.decide.possible_edge import PossibleEdge, possible_edges
from sonarmap.slam.decide.robust import robust_optimize
from sonarmap.slam.decide.verdict import with_verdicts
from sonarmap.slam.decide.weak_steps import without_weak_steps
from sonarmap.slam.decide.wrong_control import WrongControl, without_wrong_control
from sonarmap.slam.decide.wrong_measurements import JudgedFixes, judge_fixes
from sonarmap.slam.graph.control import ControlPoint, MeasuredControl
from sonarmap.slam.graph.edge import Edge, components, spanning_tree
from sonarmap.slam.graph.place import place_by_control, place_in_world
from sonarmap.slam.graph.pose_covariance import weighed
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.slam.pair import Pair, RegisteredPair
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registration

# Share of the sigmas added to cycles that is added to edges during outlier rejection: scans can be bent, for example.
_GRAPH_FLOOR = 0.2
_RESTARTS = 3  # optimizations of a graph with priors from its own optimum, which then moves by less than 1 micrometer


@dataclass(frozen=True, slots=True)
class Decision:
    """The result of the inference about a survey's registrations."""

    chained: Trajectory  # N poses from the trusted edges alone, without loops
    solution: Solution  # the optimized graph of the edges that were kept
    pairs: tuple[Pair, ...]  # every pair with its verdict, in the given order
    fixes: JudgedFixes = field(default_factory=lambda: JudgedFixes({}))  # accepted measurements of instruments
    wrong_control: tuple[WrongControl, ...] = ()  # control points that were left out, as all others contradict them
    drifts: float = 1.0  # ratio of the actual to the stated drift of dead reckoning
    other_places: tuple[OtherPlace, ...] = ()  # parts of the map that other pairs place elsewhere
    interpolated: tuple[int, ...] = ()  # scans of a stream without a usable registration

    @property
    def understated(self) -> dict[str, float]:
        """Ratio of actual to stated errors, of the kinds of measurement where it is clearly above 1."""
        return dict(self.fixes.understated) | ({"odometry": self.drifts} if self.drifts > 1 else {})

    def without_scans(self, scans: Set[int]) -> "Decision":
        """The decision with these scans in no map: without their edges and their priors."""
        graph = self.solution.graph
        edges = tuple(edge for edge in graph.edges if scans.isdisjoint((edge.i, edge.j)))
        priors = tuple((k, prior) for k, prior in graph.priors if k not in scans)
        pairs = (
            pair if scans.isdisjoint(pair.scans) else replace(pair, edge=None, reason="refused: a scan is faulty")
            for pair in self.pairs
        )
        solution = _settled(replace(graph, edges=edges, priors=priors))
        places = tuple(place for place in self.other_places if scans.isdisjoint(place.scans))
        return replace(self, solution=solution, pairs=tuple(pairs), other_places=places)

    def points(self, control: Sequence[ControlPoint]) -> tuple[MeasuredControl, ...]:
        """Where the poses place the control points, check points included."""
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
    """Choose the hypotheses to use, among those of all pairs, and optimize.

    Accepted registrations of consecutive scans form the chain. All other hypotheses, alternatives and refused ones
    included, have to agree with the chain or with one another; those that join components come first. Outlier rejection
    can then reject any of these edges, also of the chain. Pairs that a person accepted or added are always edges, pairs
    that a person rejected never. A doubtful consecutive pair is a gap if the pairs beside it are refused
    (`weak_steps`), except where dead reckoning joins its scans. `voxel` is in meters.
    """
    pairs = without_weak_steps(pairs, {*measurements.ties, *((edge.i, edge.j) for edge in measurements.steps)})
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
    """As `decide`, with `distrusted` pairs kept out of the chain; also the chain's pairs that the graph contradicts."""
    count, odometry, priors = len(measurements.scans), measurements.steps, measurements.priors
    possible = _Possible.of(pairs, measurements, floor, bound, distrusted)
    edges = (*possible.trusted, *(hypothesis.edge() for hypothesis in possible.taken.values()), *odometry)
    trusted = [*possible.trusted, *odometry, *possible.joins]
    parts = components(count, trusted)
    chained = place_in_world(chain(trusted, measurements.stamps), parts, priors)
    chained = place_by_control(chained, parts, measurements.control, priors)
    widened = _widened(PoseGraph(chained, edges), _GRAPH_FLOOR * floor)
    # by all pairs: two steps alone would yield to ten wrong fixes in a row
    judged = judge_fixes(widened, priors)
    holding = tuple(point for point in measurements.control if point.holds)
    widened = replace(widened, priors=tuple(sorted(judged.priors.items())), control=holding)
    control, wrong_control = without_wrong_control(widened)
    robust = robust_optimize(replace(widened, control=control), trust_chain=False)
    graph = replace(widened, edges=edges, control=control)
    kept_graph = weighed(graph.keep(robust.accepted).at(robust.solution.trajectory.T_world_sensor))
    # with loops the poses are accurate enough to show smaller errors, and errors that all fixes share
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
    """The optimum, optimized again from itself: motions that nothing measures stay where the optimizer starts."""
    solution = graph.optimize()
    for _ in range(_RESTARTS if graph.priors or graph.control else 0):
        solution = solution.graph.optimize()
    return solution


@dataclass(frozen=True, slots=True)
class _Possible:
    """Edges and possible edges before the graph is optimized."""

    trusted: list[Edge]  # the edges of the chain, and pairs that a person accepted or added
    joins: list[Edge]  # hypotheses that join components of these
    # one hypothesis of a pair, for the optimizer beside `trusted`, by the pair's scans
    taken: dict[tuple[int, int], PossibleEdge]
    supported: list[PossibleEdge]  # all hypotheses outside the chain, with their support
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
            return compare(chain_parts(count, [*known, *odometry]), hypotheses, floor, bound)

        not_rejected = [p for p in pairs if p.scans not in ties or ties[p.scans].verdict != "reject"]
        trusted = [edge for pair in not_rejected if pair.scans not in distrusted and (edge := _chain_edge(pair))]
        chain_scans = {(edge.i, edge.j) for edge in trusted}
        hypotheses = [
            edge
            for pair in not_rejected
            if pair.scans not in chain_scans
            for edge in possible_edges(pair)
            if not edge.fault
        ]
        supported = compared_with(trusted).support(hypotheses)
        automatic = {scans: hypothesis.registration for scans, hypothesis in _taken(supported).items()}
        manual = _hand_edges(not_rejected, ties, automatic)
        if manual:
            trusted = [*(edge for edge in trusted if (edge.i, edge.j) not in manual), *manual.values()]
            supported = compared_with(trusted).support(hypotheses)
        joins: list[Edge] = []
        while new_joins := _joins(count, [*trusted, *odometry, *joins], supported):
            joins += new_joins
            supported = compared_with([*trusted, *joins]).support(hypotheses)
        taken = {scans: hypothesis for scans, hypothesis in _taken(supported).items() if scans not in manual}
        return cls(trusted, joins, taken, supported, chain_scans)


def _widened(graph: PoseGraph, floor: np.ndarray) -> PoseGraph:
    """The graph with (6,) standard deviations added in quadrature to those of each registration."""

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


def _hand_edges(
    pairs: Sequence[RegisteredPair],
    ties: Mapping[tuple[int, int], Tie],
    taken: Mapping[tuple[int, int], Registration],
) -> dict[tuple[int, int], Edge]:
    """The edges of the pairs that a person accepted or added, by their scans, even if others contradict them.

    A registration with alternatives contributes the hypothesis in `taken`, which the survey would use by itself, else
    the most probable one. Pairs without a registration, or with an invalid covariance, have no edge.
    """
    edges: dict[tuple[int, int], Edge] = {}
    for pair in pairs:
        tie = ties.get(pair.scans)
        if tie is None or tie.verdict == "reject" or pair.registration is None:
            continue
        chosen = taken.get(pair.scans, pair.registration) if tie.given is None else pair.registration
        kind = "tie" if tie.given is not None else "sequential" if pair.role == "sequential" else "loop"
        with suppress(InputError):  # the covariance is invalid; see `PossibleEdge.fault`
            edges[pair.scans] = Edge(pair.i, pair.j, chosen, kind, by_hand=True)
    return edges


def _joins(count: int, trusted: Sequence[Edge], supported: Sequence[PossibleEdge]) -> list[Edge]:
    """The fewest hypotheses that join components of the chain, the best supported first."""
    joining = [possible for possible in supported if possible.joins_parts and possible.may_join]
    joining.sort(key=lambda possible: (-possible.support.pairs, -possible.weight, *possible.scans))
    edges = [possible.edge() for possible in joining]
    tree = {id(edge) for edge in spanning_tree(count, [*trusted, *edges])}
    return [edge for edge in edges if id(edge) in tree]


def _taken(supported: Sequence[PossibleEdge]) -> dict[tuple[int, int], PossibleEdge]:
    """The best supported hypothesis of every pair that may be used, by the pair's scans."""

    def standing(possible: PossibleEdge) -> tuple[bool, int, float]:
        return possible.support.agrees, possible.support.pairs, possible.weight

    taken: dict[tuple[int, int], PossibleEdge] = {}
    for possible in supported:
        if possible.may_be_taken:
            taken[possible.scans] = max(taken.get(possible.scans, possible), possible, key=standing)
    return taken
