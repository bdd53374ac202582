"""The mapper: scans in, one consistent map out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import Decision, decide
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.other_place import other_places
from sonarmap.slam.decide.verdict import with_contradictions
from sonarmap.slam.execute.runner import Execution, PairRunner, Progress
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.free_pairs import errors_shown, register_freely
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.pose_covariance import pose_covariances
from sonarmap.slam.map.doubtful_points import MIN_SEEN, ComponentMaps, component_maps
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.motion.limits import MotionLimits
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.motion.straighten import Straightened, Way, sharper, straightened, ways
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.slam.odd.odd_scan import find_odd
from sonarmap.slam.odd.scaled import find_scaled
from sonarmap.slam.pair import RegisteredPair, require_any_registered
from sonarmap.slam.pair_search import PairSearch
from sonarmap.slam.stream.between import with_between
from sonarmap.slam.stream.keys import KeySettings, choose_keys
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """Settings of the mapper.

    Attributes:
        loops: which extra pairs are tried and kept.
        limits: what the vehicle's motion cannot exceed.
        keys: how key scans of a dense stream are chosen.
        bridge: over a gap, pairs up to this many scans apart are tried; 1 tries none.
        prepared: number of prepared scans kept at a time, each of which holds device memory; None for as many as are
            useful and fit.
        map_voxel: edge of the fused map's voxels [m]; None is the survey's voxel.
        min_seen: points that fewer scans saw are left out of the map where others contradict them, see
            `slam.map.doubtful_points`; 1 leaves out none.
        straighten: whether to correct scans whose points have times for the sensor's motion, if they then fit better.
    """

    loops: LoopSettings = field(default_factory=LoopSettings)
    limits: MotionLimits = field(default_factory=MotionLimits)
    keys: KeySettings = field(default_factory=KeySettings)
    bridge: int = 3
    prepared: int | None = None
    map_voxel: float | None = None
    min_seen: int = MIN_SEEN
    straighten: bool = True

    def __post_init__(self) -> None:
        if self.bridge < 1:
            raise InputError(f"`bridge={self.bridge}`: wanted at least 1")
        if self.prepared is not None and self.prepared < 2:
            raise InputError(f"`prepared={self.prepared}`: wanted at least 2")
        if self.map_voxel is not None and not (np.isfinite(self.map_voxel) and self.map_voxel > 0):
            raise InputError(f"the map's voxel is {self.map_voxel} m; wanted a positive length")
        if self.min_seen < 1:
            raise InputError(f"`min_seen={self.min_seen}`: wanted at least 1, which leaves no point out")


_MAX_STRAIGHTENINGS = 2  # rounds of straightening
_MIN_SHIFT = 0.1  # of a point in a round [voxels]; a round without a larger one is the last


@dataclass(slots=True)
class _Rounds:
    """The common progress of maps that are made one after another."""

    report: Progress
    before: int = 0  # steps that were done before this map
    done: int = 0

    def __call__(self, done: int, planned: int, text: str) -> None:
        self.done = self.before + done
        self.report(self.done, self.before + planned, text)

    def begin_again(self) -> None:
        self.before = self.done


class Mapper:
    """Registers a survey's scans and fuses them into a map.

    Args:
        registrar: any method of registration.
        voxel: edge of the survey's voxels [m].
        settings: everything else.
        execution: how pairs are registered, by the same registrar, and the journal; None: in this process, without one.
    """

    def __init__(
        self,
        registrar: Registrar,
        voxel: float,
        settings: MapperSettings | None = None,
        execution: Execution | None = None,
    ) -> None:
        if not (np.isfinite(voxel) and voxel > 0):
            raise InputError(f"the survey's voxel is {voxel} m; wanted a positive length")
        self.registrar = registrar
        self.voxel = voxel
        self.settings = settings or MapperSettings()
        self.execution = execution or Execution(Worker(registrar, self.settings.prepared or prepared_limit(registrar)))

    def run(
        self,
        scans: Sequence[Scan],
        progress: Progress | None = None,
        surveys: Sequence[int] | None = None,
        odometry: Odometry | None = None,
        ties: Sequence[Tie] = (),
        control: Sequence[ControlPoint] = (),
        vet: Callable[[Sequence[RegisteredPair]], None] | None = None,
        turn_rates: TurnRates | None = None,
    ) -> SurveyResult:
        """Map a survey, or several of one place.

        A pair that fails leaves a gap; the scans after it are a component of their own, unless other pairs join both
        sides. Scans whose points have times are corrected for the sensor's motion, and mapped again.

        Args:
            scans: at least two, in the order in which they were taken, survey after survey.
            progress: called as progress(steps done, steps planned so far, words); the plan grows as
                candidates for bridges and loops are found.
            surveys: the number of each scan's survey, ascending; by default all are of one.
            odometry: dead reckoning of these scans.
            ties: a person's verdicts on pairs, at most one of each. They do not change the search; pairs that a
                person added are registered too.
            control: points of scans with known coordinates, which take part only after the search for pairs.
            vet: called with some pairs that are registered without priors, before priors bound any pair; it may raise
                to end the run.
            turn_rates: of the sensor, by the clock of the stamps; they help to straighten scans.

        Raises:
            InputError: fewer than two scans, no pair that could be registered, ties or control points of missing scans,
                or ties of scans between the key scans of a dense stream.
        """
        if len(scans) < 2:
            raise InputError(f"{len(scans)} scan given; a map needs at least two that overlap")
        _require_scans(len(scans), ties, control)
        number = np.zeros(len(scans), np.intp) if surveys is None else np.asarray(surveys, np.intp)
        by_scans = {tie.scans: tie for tie in ties}
        measurements = Measurements(tuple(scans), number, odometry, tuple(control), by_scans)
        rounds = None if progress is None else _Rounds(progress)
        return self._straightened(measurements, self._mapped(measurements, rounds, vet), rounds, turn_rates)

    def decided(
        self,
        scans: Sequence[Scan],
        surveys: np.ndarray,
        known: Sequence[RegisteredPair],
        settled: int = 0,
        looked: dict[tuple[int, int], RegisteredPair] | None = None,
        odometry: Odometry | None = None,
    ) -> Decision:
        """The decision about at least two scans, for a growing map; `surveys` and `odometry` are as of `run`, `known`
        pairs are already registered, `settled` and `looked` are as of `PairSearch`.

        Raises:
            InputError: no pair could be registered.
        """
        measurements = Measurements(tuple(scans), surveys, odometry)
        runner = PairRunner(self.execution, measurements.searched(), 0, None)
        return self._decided(runner, measurements, known, settled, looked)

    def _straightened(
        self,
        measurements: Measurements,
        result: SurveyResult,
        progress: "_Rounds | None",
        turn_rates: TurnRates | None,
    ) -> SurveyResult:
        """The map of the scans corrected for the sensor's motion, if they then fit together better; else the map that
        is given."""
        straight = Straightened.none(measurements.scans)
        have_times = any(scan.times is not None for scan in measurements.scans)
        for _ in range(_MAX_STRAIGHTENINGS if self.settings.straighten and have_times else 0):
            runs = ways(result.components, result.surveys, result.trajectory.stamps)
            taken, bent, before = measurements.scans, result.straightened is None, straight
            straight = straightened(taken, result.trajectory, runs, self.voxel / 2, bent, turn_rates)
            if straight.farthest_from(before) < _MIN_SHIFT * self.voxel:
                break
            if progress is not None:
                progress.begin_again()
            again = self._mapped(replace(measurements, scans=straight.scans), progress)
            fewer = max(map(len, again.components)) < max(map(len, result.components))
            if fewer or sharper(again.pairs, result.pairs) <= 0:
                break
            way = Way(result.trajectory, tuple(map(tuple, runs)), bent, turn_rates is not None)
            result = replace(again, straightened=tuple(straight.moved.tolist()), way=way)
        return result

    def _mapped(
        self,
        measurements: Measurements,
        progress: Progress | None,
        vet: Callable[[Sequence[RegisteredPair]], None] | None = None,
    ) -> SurveyResult:
        scans, number, control = measurements.scans, measurements.surveys, measurements.control
        ties = tuple(measurements.ties.values())
        try:
            runner, searched = self._searching(measurements, progress, vet)
            keys, known = choose_keys(runner, measurements.runs, self.voxel, self.settings.keys)
            if len(keys) == len(scans):
                decision = self._decided(runner, measurements, known)
            else:
                decision = self._decided_by_keys(runner, measurements, keys, known)
            floor, bound = self.settings.loops.floor(self.voxel), self.settings.loops.bound
            if odd := find_odd(runner, searched, measurements.runs, decision, floor, bound):
                decision = decision.without_scans({each.scan for each in odd})
            members = set(max(decision.solution.graph.components, key=len))
            scaled = find_scaled(runner, searched, [pair for pair in decision.pairs if pair.kept and pair.i in members])
        finally:
            self.execution.worker.release()
        runner.step_done("poses optimized")
        result = replace(self._fuse(scans, number, decision), ties=ties, control=decision.points(control))
        runner.step_done("map fused")
        return replace(result, odd=odd, scaled=scaled, keys=None if len(keys) == len(scans) else tuple(keys))

    def _searching(
        self,
        measurements: Measurements,
        progress: Progress | None,
        vet: Callable[[Sequence[RegisteredPair]], None] | None,
    ) -> tuple[PairRunner, tuple[Scan, ...]]:
        """The runner of the pairs and its scans, with priors no tighter than some freely registered pairs support."""
        searched = measurements.searched()
        runner = PairRunner(self.execution, searched, 2, progress)
        free = register_freely(runner, measurements.scans, measurements.runs)
        if vet is not None:
            vet(free)
        if understated := errors_shown(free, measurements.priors):
            searched = measurements.searched(understated)
            runner = PairRunner(self.execution, searched, 2, progress)
        return runner, searched

    def _decided_by_keys(
        self,
        runner: PairRunner,
        measurements: Measurements,
        keys: Sequence[int],
        known: Sequence[RegisteredPair],
    ) -> Decision:
        """The decision about the key scans, extended to all scans."""
        number = {k: n for n, k in enumerate(keys)}
        key_pairs = [pair.renumbered(number) for pair in known]
        decision = self._decided(runner.of(keys), measurements.take(keys), key_pairs)
        floor, bound = self.settings.loops.floor(self.voxel) / 4, self.settings.loops.bound
        return with_between(decision, keys, measurements, floor, bound, runner)

    def _decided(
        self,
        runner: PairRunner,
        measurements: Measurements,
        known: Sequence[RegisteredPair],
        settled: int = 0,
        looked: dict[tuple[int, int], RegisteredPair] | None = None,
    ) -> Decision:
        """The decision about all pairs of some scans that can be registered; `known` ones already are.

        The search ignores ties and control points, so that it registers the same pairs with and without them.
        """
        settings = self.settings.loops
        limits = self.settings.limits
        search = PairSearch(runner, measurements, self.registrar, self.voxel, settings, limits, settled, looked)
        pairs = search.steps(known)
        measurements = search.measurements
        untied = measurements.by_instruments
        pairs += search.bridges(pairs, self.settings.bridge)
        require_any_registered(pairs)
        decision = self._decide(runner, untied, pairs)
        for number in range(settings.most_rounds if settings.rounds else 0):
            loops = search.loops(decision, pairs, unsure=number >= settings.rounds)
            if not loops:
                break
            pairs += loops
            decision = self._decide(runner, untied, pairs)
        if measurements.ties or measurements.control:
            tied = self._decide(runner, measurements, search.tied(pairs))
            decision = replace(tied, pairs=tuple(with_contradictions(tied.pairs, decision.solution)))
        graph, floor = decision.solution.graph, settings.floor(self.voxel)
        return replace(decision, other_places=other_places(graph, decision.pairs, floor, settings.bound))

    def _decide(self, runner: PairRunner, measurements: Measurements, pairs: Sequence[RegisteredPair]) -> Decision:
        decision = decide(pairs, measurements, self.voxel, self.settings.loops)
        runner.end_stage("poses optimized")
        return decision

    def _fuse(self, scans: Sequence[Scan], survey: np.ndarray, decision: Decision) -> SurveyResult:
        solution, covariances = decision.solution, pose_covariances(decision.solution)
        trajectory, components = solution.trajectory, solution.graph.components
        parts: list[ComponentMaps] = []
        for component in components:
            members = list(component)
            placed = PlacedScans.of(
                [scans[k] for k in members],
                trajectory.T_world_sensor[members],
                self.settings.map_voxel or self.voxel,
                members,
                covariances[members],
                survey[members].tolist(),
            )
            parts.append(component_maps(placed, decision.chained.take(members), self.settings.min_seen))
        return SurveyResult(
            trajectory=trajectory,
            chained=decision.chained,
            components=components,
            surveys=tuple(survey.tolist()),
            covariances=covariances,
            solution=solution,
            parts=tuple(parts),
            pairs=decision.pairs,
            gaps=tuple((pair.i, pair.j) for pair in decision.pairs if pair.role == "sequential" and not pair.kept),
            voxel=self.voxel,
            wrong_fixes=decision.fixes.wrong,
            understated=decision.understated,
            systematic=decision.fixes.systematic,
            interpolated=decision.interpolated,
            other_places=decision.other_places,
            names=tuple(scan.name for scan in scans),
        )


def _require_scans(count: int, ties: Sequence[Tie], control: Sequence[ControlPoint]) -> None:
    """Refuse ties and control points of missing scans, and two ties of a pair."""
    named = [*(tie.j for tie in ties), *(point.scan for point in control)]
    if named and not (max(named) < count and min(named) >= 0):
        raise InputError(f"a tie or control point names scan {max(named)}; there are {count}, counted from 0")
    if len({tie.scans for tie in ties}) < len(ties):
        raise InputError("two ties name the same scans; leave one out")
