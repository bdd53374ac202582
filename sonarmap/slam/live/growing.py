"""The map while it grows: where key scans lie, in which parts, and how surely."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import Event, Lock
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.runner import PairRunner, Timings
from sonarmap.slam.execute.worker import Job, PairWorker, Sources, TimedText
from sonarmap.slam.graph.pose_covariance import pose_covariances
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.live.tracker import Placed, Tracker
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

# Key scans with what navigation measured of them until now, and dead reckoning at their times.
Navigate = Callable[[Sequence[Scan]], tuple[Sequence[Scan], Odometry | None]]

_LONGEST_WAIT = 1.0  # of a pair for which there is time [s]


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a sensor is in a part of the map."""

    part: int  # the number of the part's first key scan
    T_part_sensor: RigidTransform
    covariance: np.ndarray  # (6, 6), rotation first [rad, m], body tangent


class GrowingMap:
    """Places scans as they come, by one thread; another one may decide all anew meanwhile.

    Args:
        navigate: what says where key scans were, beside themselves; None for nothing.

    Attributes:
        tracker: what places scans.
        poses: of the key scans, as the last decision has them, and later ones by their steps.
        loops: numbers of the key scans that loops join.
        idle: to be set while no scan waits: the other thread registers pairs then, or after a while.
        decided: how many key scans the last decision knew.
        settled: how many are of a finished map.
        seconds: how long it took [s].
        voxel: edge of the survey's voxels [m].
    """

    def __init__(self, mapper: Mapper, navigate: Navigate | None = None) -> None:
        self.idle, lock, settings = Event(), Lock(), mapper.settings
        tracking = replace(mapper.execution, worker=_Turns(mapper.execution.worker, lock), journal=None)
        deciding = replace(mapper.execution, worker=_Turns(mapper.execution.worker, lock, self.idle), timings=Timings())
        # the rounds that follow for what is not sure wait for the map at the end
        briefly = replace(settings, loops=replace(settings.loops, most_rounds=settings.loops.rounds))
        self._mapper = Mapper(mapper.registrar, mapper.voxel, briefly, deciding)

        def register(target: Scan, source: Scan, candidate: Candidate) -> RegisteredPair:
            number, back = {candidate.i: 0, candidate.j: 1}, {0: candidate.i, 1: candidate.j}
            runner = PairRunner(tracking, [target, source], 0, None)
            tracking.timings.pairs.clear()  # nobody asks, and a dive is long
            return runner.register([candidate.renumbered(number)])[0].renumbered(back)

        floor = settings.loops.floor(mapper.voxel)
        looks_again = hasattr(mapper.registrar, "register_expected")
        self.tracker = Tracker(register, looks_again, mapper.voxel, floor, settings.limits, settings.keys)
        self.poses: list[Pose] = []
        self.loops: list[tuple[int, int]] = []
        self._navigate = navigate
        self._found: tuple[list[Pose], list[tuple[int, int]], Sequence[Scan]] | None = None
        self.settled = 0
        # second looks, which are not repeated whenever the estimate changes: the map at the end does
        self._looked: dict[tuple[int, int], RegisteredPair] = {}
        self.decided, self.seconds, self.voxel = 0, 0.0, mapper.voxel

    def add(self, scan: Scan, last_chance: bool = True) -> Placed | None:
        """Place the next scan, as `Tracker.add`."""
        placed = self.tracker.add(scan, last_chance)
        for number in range(len(self.poses), len(self.tracker.keys)):
            self.poses.append(self._by_step(number, self.poses))
        return placed

    def pose(self, placed: Placed) -> Pose:
        return _moved(self.poses[placed.key], placed.T_key_sensor, placed.covariance)

    def restore(self, scan: Scan, step: Registration | None, of_map: bool = False) -> None:
        """Take a key scan of an earlier run, or `of_map`, a finished one, with its step to the one before; None where
        it began a part."""
        self.tracker.restore(scan, step)
        self.tracker.anew = of_map  # nobody knows where the next one lies to it
        self.settled += of_map
        self.poses.append(self._by_step(len(self.poses), self.poses))

    def knows_up(self, part: int) -> bool:
        """Whether a part's z axis points up."""
        prior = self.tracker.keys[part].prior
        return prior is not None and prior.knows_attitude

    @property
    def parts(self) -> dict[int, int]:
        """How many key scans every part has, by its number."""
        return Counter(pose.part for pose in self.poses)

    def forget_journal(self) -> None:
        """Register pairs without it, as where the disk is full."""
        mapper = self._mapper
        execution = replace(mapper.execution, journal=None)
        self._mapper = Mapper(mapper.registrar, mapper.voxel, mapper.settings, execution)

    def decide(self) -> None:
        """Search for loops among the key scans so far, and optimize; `take_over` has what comes of it. May be called by
        another thread than the others.

        Raises:
            DeviceError, InputError: the machine failed, or the journal cannot be used.
        """
        begun = perf_counter()
        # keys first: the tracker says of a part that it starts before it adds its key scan
        keys: Sequence[Scan] = list(self.tracker.keys)
        starts = set(self.tracker.starts)
        known = [step for k in range(1, len(keys)) if k not in starts and (step := self.tracker.steps.get(k))]
        if not known:  # nothing that could be joined
            return
        odometry = None
        if self._navigate is not None:
            keys, odometry = self._navigate(keys)
        # parts are surveys of their own: only places that look alike join them, and no step over what came between,
        # but for one that dead reckoning knows too
        surveys = np.cumsum([k in starts and odometry is None for k in range(len(keys))]) - 1
        decision = self._mapper.decided(keys, surveys, known, self.settled, self._looked, odometry)
        self._mapper.execution.timings.pairs.clear()
        solution, covariances = decision.solution, pose_covariances(decision.solution)
        T, graph = solution.trajectory.T_world_sensor, solution.graph
        poses: dict[int, Pose] = {}
        for members in graph.components:
            number = min(members)
            in_world = graph.gauge.lies_in_world(members)
            first = RigidTransform.identity() if in_world else _level(keys[number]) * T[number].inv()
            poses |= {k: Pose(number, first * T[k], covariances[k]) for k in members}
        loops = [pair.scans for pair in decision.pairs if pair.kept and pair.role == "loop"]
        self._found = [poses[k] for k in range(len(keys))], loops, keys
        self.seconds = perf_counter() - begun

    def take_over(self) -> bool:
        """Take over what was decided, if anything new was; the key scans that came meanwhile go on by their steps."""
        if self._found is None:
            return False
        (poses, self.loops, keys), self._found = self._found, None
        self.decided = len(poses)
        for number, key in enumerate(keys):
            self.tracker.keys[number] = replace(self.tracker.keys[number], prior=key.prior)
        for number in range(len(poses), len(self.tracker.keys)):
            poses.append(self._by_step(number, poses))
        self.poses = poses
        return True

    def _by_step(self, number: int, poses: Sequence[Pose]) -> Pose:
        """A key scan's pose by the one before; it begins a part where no step leads to it."""
        step = self.tracker.steps.get(number)
        if step is None or step.registration is None:
            return Pose(number, _level(self.tracker.keys[number]), np.zeros((6, 6)))
        return _moved(poses[number - 1], step.registration.T_target_source, step.registration.covariance)


def _level(key: Scan) -> RigidTransform:
    """The pose with which a part begins: level where its first scan's attitude is known, in the world where all is."""
    prior = key.prior
    if prior is None or not prior.knows_attitude:
        return RigidTransform.identity()
    return prior.T_world_sensor if prior.is_complete else RigidTransform.from_rotation(prior.T_world_sensor.rotation)


def _moved(pose: Pose, T: RigidTransform, covariance: np.ndarray) -> Pose:
    """A pose and a step from it."""
    return Pose(pose.part, pose.T_part_sensor * T, propagated(T.inv(), pose.covariance) + covariance)


class _Turns:
    """A worker that threads share: each pair waits for the one before, and, where it has time, for no scan to come."""

    def __init__(self, worker: PairWorker, lock: Lock, idle: Event | None = None) -> None:
        self._worker, self._lock, self._idle = worker, lock, idle

    def run(self, jobs: Sequence[Job], sources: Sources) -> list[TimedText]:
        if self._idle is not None:
            self._idle.wait(_LONGEST_WAIT)
        with self._lock:
            return self._worker.run(jobs, sources)

    def release(self) -> None:
        """Nothing: the other thread goes on."""
