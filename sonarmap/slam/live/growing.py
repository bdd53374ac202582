"""The growing map: poses of its key scans, their covariances, and the parts that they form."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import Event, Lock

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.job import Job
from sonarmap.slam.execute.runner import PairRunner, Timings
from sonarmap.slam.execute.worker import PairWorker, TimedText
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.live.tracker import Placed, Tracker
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

# Returns the key scans with the priors that navigation gives by now, and dead reckoning at their times.
Navigate = Callable[[Sequence[Scan]], tuple[Sequence[Scan], Odometry | None]]

_MAX_WAIT = 1.0  # of a pair of the background thread [s]


@dataclass(frozen=True, slots=True)
class Known:
    """What is known about the key scans at one time."""

    keys: Sequence[Scan]  # with their priors at that time
    surveys: np.ndarray  # (N,) number of each one's survey
    steps: Sequence[RegisteredPair]  # consecutive ones, registered without the navigation
    odometry: Odometry | None


@dataclass(frozen=True, slots=True)
class Pose:
    """A sensor's pose in a part of the map."""

    part: int  # number of the part's first key scan
    T_part_sensor: RigidTransform
    covariance: np.ndarray  # (6, 6), rotation first [rad, m], body tangent


class GrowingMap:
    """Places scans as they arrive in one thread, while another thread may search for loops and optimize.

    Args:
        navigate: adds navigation to key scans; None without navigation.

    Attributes:
        tracker: places the scans.
        poses: of the key scans, by the last decision; of later ones, by their steps.
        loops: pairs of key scan numbers that loops join.
        idle: set it while no scan waits: the other thread registers pairs then, or after at most a second each.
        decided: number of key scans in the last decision.
        settled: number of key scans of a finished map.
        seconds: computing time of the last decision [s].
        voxel: edge of the survey's voxels [m].
    """

    def __init__(self, mapper: Mapper, navigate: Navigate | None = None) -> None:
        self.idle, lock, settings = Event(), Lock(), mapper.settings
        tracking = replace(mapper.execution, worker=_Turns(mapper.execution.worker, lock), journal=None)
        deciding = replace(mapper.execution, worker=_Turns(mapper.execution.worker, lock, self.idle), timings=Timings())
        # the further rounds for uncertain scans are left to the final map
        briefly = replace(settings, loops=replace(settings.loops, most_rounds=settings.loops.rounds))
        self._mapper = Mapper(mapper.registrar, mapper.voxel, briefly, deciding)

        def register(target: Scan, source: Scan, candidate: Candidate) -> RegisteredPair:
            number, back = {candidate.i: 0, candidate.j: 1}, {0: candidate.i, 1: candidate.j}
            runner = PairRunner(tracking, [target, source], 0, None)
            tracking.timings.pairs.clear()  # unused, and they would grow for a whole dive
            return runner.register([candidate.renumbered(number)])[0].renumbered(back)

        floor = settings.loops.floor(mapper.voxel)
        looks_again = hasattr(mapper.registrar, "register_expected")
        self.tracker = Tracker(register, looks_again, mapper.voxel, floor, settings.limits, settings.keys)
        self.poses: list[Pose] = []
        self.loops: list[tuple[int, int]] = []
        self._navigate = navigate
        self._decision: tuple[list[Pose], list[tuple[int, int]], Sequence[Scan]] | None = None
        self.settled = 0
        # registrations at expected poses; only the final map repeats them when the estimate changes
        self._looked: dict[tuple[int, int], RegisteredPair] = {}
        self.decided, self.seconds, self.voxel = 0, 0.0, mapper.voxel

    def add(self, scan: Scan, last_chance: bool = True) -> Placed | None:
        """Place the next scan (see `Tracker.add`)."""
        placed = self.tracker.add(scan, last_chance)
        for number in range(len(self.poses), len(self.tracker.keys)):
            self.poses.append(self._by_step(number, self.poses))
        return placed

    def pose(self, placed: Placed) -> Pose:
        return _moved(self.poses[placed.key], placed.T_key_sensor, placed.covariance)

    def restore(self, scan: Scan, step: Registration | None, of_map: bool = False) -> None:
        """Add a key scan of an earlier run (or of a finished map, `of_map`) with its step from the one before; None for
        the first of a part."""
        self.tracker.restore(scan, step)
        self.tracker.anew = of_map  # the next scan's pose relative to it is unknown
        self.settled += of_map
        self.poses.append(self._by_step(len(self.poses), self.poses))

    def knows_up(self, part: int) -> bool:
        """Whether a part's z axis points up."""
        prior = self.tracker.keys[part].prior
        return prior is not None and prior.knows_attitude

    @property
    def parts(self) -> dict[int, int]:
        """Numbers of key scans, by part."""
        return Counter(pose.part for pose in self.poses)

    def forget_journal(self) -> None:
        """Go on without the journal, for example when the disk is full."""
        mapper = self._mapper
        execution = replace(mapper.execution, journal=None)
        self._mapper = Mapper(mapper.registrar, mapper.voxel, mapper.settings, execution)

    def known(self) -> Known | None:
        """The key scans with navigation; None without a step. May run in another thread than the other methods."""
        # copy the keys first: the tracker adds the start of a part before its key scan
        keys: Sequence[Scan] = list(self.tracker.keys)
        starts = set(self.tracker.starts)
        steps = [step for k in range(1, len(keys)) if k not in starts and (step := self.tracker.steps.get(k))]
        if not steps:
            return None
        odometry = None
        if self._navigate is not None:
            keys, odometry = self._navigate(keys)
        # without dead reckoning, each part is a survey of its own: loops may join it to others, but no consecutive pair
        surveys = np.cumsum([k in starts and odometry is None for k in range(len(keys))]) - 1
        return Known(keys, surveys, steps, odometry)

    def decide(self, known: Known) -> SurveyResult:
        """Search for loops among the key scans, and optimize; `take_over` applies the result. May run in another
        thread than the other methods. Returns the survey without its maps.

        Raises:
            DeviceError, InputError: the machine failed, or the journal cannot be used.
        """
        keys = known.keys
        result = self._mapper.decided(keys, known.surveys, known.steps, self.settled, self._looked, known.odometry)
        self._mapper.execution.timings.pairs.clear()
        T, graph = result.trajectory.T_world_sensor, result.solution.graph
        poses: dict[int, Pose] = {}
        for members in graph.components:
            number = min(members)
            in_world = graph.gauge.lies_in_world(members)
            first = RigidTransform.identity() if in_world else _level(keys[number]) * T[number].inv()
            poses |= {k: Pose(number, first * T[k], result.covariances[k]) for k in members}
        loops = [pair.scans for pair in result.pairs if pair.kept and pair.role == "loop"]
        self._decision = [poses[k] for k in range(len(keys))], loops, keys
        return result

    def take_over(self) -> bool:
        """Apply a new decision, if there is one; key scans added since it was begun follow by their steps."""
        if self._decision is None:
            return False
        (poses, self.loops, keys), self._decision = self._decision, None
        self.decided = len(poses)
        for number, key in enumerate(keys):
            self.tracker.keys[number] = replace(self.tracker.keys[number], prior=key.prior)
        for number in range(len(poses), len(self.tracker.keys)):
            poses.append(self._by_step(number, poses))
        self.poses = poses
        return True

    def _by_step(self, number: int, poses: Sequence[Pose]) -> Pose:
        """A key scan's pose by its step from the one before; without a step, the first pose of a part."""
        step = self.tracker.steps.get(number)
        if step is None or step.registration is None:
            return Pose(number, _level(self.tracker.keys[number]), np.zeros((6, 6)))
        return _moved(poses[number - 1], step.registration.T_target_source, step.registration.covariance)


def _level(key: Scan) -> RigidTransform:
    """The first pose of a part: the scan's prior if it is complete, its attitude if that is known, or the identity."""
    prior = key.prior
    if prior is None or not prior.knows_attitude:
        return RigidTransform.identity()
    return prior.T_world_sensor if prior.is_complete else RigidTransform.from_rotation(prior.T_world_sensor.rotation)


def _moved(pose: Pose, T: RigidTransform, covariance: np.ndarray) -> Pose:
    """The pose and covariance after a step T from a pose."""
    return Pose(pose.part, pose.T_part_sensor * T, propagated(T.inv(), pose.covariance) + covariance)


class _Turns:
    """A worker that threads share: pairs run in turn; with `idle`, each waits for it first, at most `_MAX_WAIT`."""

    def __init__(self, worker: PairWorker, lock: Lock, idle: Event | None = None) -> None:
        self._worker, self._lock, self._idle = worker, lock, idle

    def run(self, jobs: Sequence[Job]) -> list[TimedText]:
        if self._idle is not None:
            self._idle.wait(_MAX_WAIT)
        with self._lock:
            return self._worker.run(jobs)

    def release(self) -> None:
        """Do nothing, as the other thread still uses the worker."""
