"""The mapper: scans in, one consistent map out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.decision import Decision
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.execute.runner import Execution, PairRunner, Progress
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.free_pairs import errors_shown, register_freely
from sonarmap.slam.fused import fused, unfused
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.motion.straighten import Straightened, Way, sharper, straightened, ways
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.slam.odd.odd_scan import find_odd
from sonarmap.slam.odd.scaled import ScaledScans, find_scaled
from sonarmap.slam.pair import RegisteredPair
from sonarmap.slam.pair_search import PairSearch
from sonarmap.slam.stream.between import with_between
from sonarmap.slam.stream.keys import choose_keys
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan

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
            scans: at least two, in the order in which they were taken, survey after survey; or one that instruments
                place, with a complete prior.
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
            InputError: too few scans, no pair that could be registered, ties or control points of missing scans,
                or ties of scans between the key scans of a dense stream.
        """
        if len(scans) < 2 and not any(scan.prior is not None and scan.prior.is_complete for scan in scans):
            raise InputError(
                f"{len(scans)} scan given; a map needs at least two that overlap, or one whose attitude, heading, "
                "depth and position are measured"
            )
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
    ) -> SurveyResult:
        """The survey of at least two scans, without maps, for a growing map. `known`: the pairs that are registered.
        `surveys` and `odometry`: see `run`; `settled` and `looked`: see `PairSearch`.

        Raises:
            InputError: no pair could be registered.
        """
        measurements = Measurements(tuple(scans), surveys, odometry)
        searched = measurements.searched()
        runner = PairRunner(self.execution, searched, 0, None)
        decision = self._decided(runner, measurements, known, settled, looked)
        result = unfused(decision, scans, surveys, self.voxel)
        return replace(result, scaled=_scaled(runner, searched, decision))

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
            scaled = _scaled(runner, searched, decision)
        finally:
            self.execution.worker.release()
        runner.step_done("poses optimized")
        map_voxel = self.settings.map_voxel or self.voxel
        result = fused(decision, scans, number, self.voxel, map_voxel, self.settings.min_seen)
        result = replace(result, ties=ties, control=decision.points(control))
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
        settings = self.settings
        loops, limits = settings.loops, settings.limits
        search = PairSearch(runner, measurements, self.registrar, self.voxel, loops, limits, settled, looked)
        return search.decided(known, settings.bridge)


def _scaled(runner: PairRunner, scans: Sequence[Scan], decision: Decision) -> ScaledScans | None:
    """Scans of the largest component whose ranges differ from those of the others."""
    members = set(max(decision.solution.graph.components, key=len))
    return find_scaled(runner, scans, [pair for pair in decision.pairs if pair.kept and pair.i in members])


def _require_scans(count: int, ties: Sequence[Tie], control: Sequence[ControlPoint]) -> None:
    """Refuse ties and control points of missing scans, and two ties of a pair."""
    named = [*(tie.j for tie in ties), *(point.scan for point in control)]
    if named and not (max(named) < count and min(named) >= 0):
        raise InputError(f"a tie or control point names scan {max(named)}; there are {count}, counted from 0")
    if len({tie.scans for tie in ties}) < len(ties):
        raise InputError("two ties name the same scans; leave one out")
