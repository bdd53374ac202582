"""The mapping process: scans in as they arrive, messages for the page out."""

import re
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from heapq import nsmallest
from multiprocessing.connection import Connection
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal
from threading import Condition, Thread
from traceback import extract_tb

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.graph.tangent import worst_sigmas
from sonarmap.slam.live.growing import GrowingMap, Pose
from sonarmap.slam.live.tracker import Placed
from sonarmap.slam.map.cell import cell_means
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.motion.sweep import span_of
from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.failures import as_options
from sonarmap.tools.command.live.kept_keys import KeptKey, keep_key, kept_keys
from sonarmap.tools.command.live.navigation import Navigation
from sonarmap.tools.command.method import MethodOptions, configure_method
from sonarmap.tools.files.finding import Finding, Remedy
from sonarmap.tools.files.map_folder.names import JOURNAL
from sonarmap.tools.files.readers.incoming import Incoming, Mark, incoming, replayed
from sonarmap.tools.files.readers.navigation.contradictions import LEAST_PAIRS
from sonarmap.tools.files.readers.scans import Corrections
from sonarmap.tools.files.time_scales import are_times
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.clearance import clearance
from sonarmap.tools.products.live.messages import State, coverage
from sonarmap.tools.products.output.trial import Evidence, MeasuredScans, ScansOnTrial, on_trial
from sonarmap.tools.products.output.upside_down import scan_clouds

_FIRST = 10  # scans from which the voxel is chosen, or
_FIRST_SECONDS = 3.0  # the scans of this time [s]
_TICK = 1.0  # interval of states while no scan comes [s]
_UNSURE = 8.0  # standard deviation of an uncertain position [voxels]: the distance between key scans
_SHOWN = 4000  # points of a key scan on the page
_LAST_SHOWN = 2500  # points of the last scan on the page
_COUNTED = 1000  # points of a key scan for the coverage
_MOST_SHOWN = 1_500_000  # points of all key scans on the page; beyond it, new ones have fewer
_COMPANY, _CLOSE = 3, 0.05  # other points near one that is no stray, and how near: a share of its range
_CELL = 4.0  # edge of a cell of the coverage [voxels]
_COVERAGE_EVERY = 2.0  # [s]
_NEW_KEYS = 4  # new key scans before the next decision, at least
_NEW_SHARE = 0.1  # share of new key scans in all of them before the next decision, at least
_BESIDE = 20  # key scans nearest to the vehicle in which the bed below it is looked for
_SPEED_OVER = 2.0  # time over which the speed is measured [s]
_TRACK = 64  # latest scans from which the speed is measured
_TRIAL_SECONDS, _TRIAL_SCANS = 10.0, 64  # of new scans before they are examined again [s], or their number
_EXAMINED = 2000  # points of a key scan by which up and down are distinguished
_IN_MEMORY = 1 << 27  # bytes of key scans in memory; the others are on disk


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """Settings of the mapping process."""

    out: Path  # the map's folder
    inputs: tuple[str, ...]  # a growing input, or finished ones to replay
    replay: float | None  # factor of the replay's speed, 0 for the highest; None for a growing input
    corrections: Corrections
    method: MethodOptions
    mapper: MapperSettings
    navigation: Navigation | None = None


def run_mapping(settings: MappingSettings, pipe: Connection) -> None:
    """Map until the input has ended or the pipe is closed. Sends states and messages of `tools.products.live`, and at
    the end None if all scans have been mapped, or else the error that ended the mapping."""
    signal(SIGINT, SIG_IGN)  # Ctrl-C is for the parent process
    try:
        _Mapping(settings, pipe).run()
        pipe.send(None)
    except (BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        pass  # the parent process has ended; the next one goes on
    except Exception as error:  # noqa: BLE001 - the parent process reports it and restarts
        pipe.send(error if isinstance(error, InputError | DeviceError) else RuntimeError(_described(error)))


def _described(error: Exception) -> str:
    """For example "ValueError: why (mapping.py, line 99)", as not every error can pass through a pipe."""
    last = extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno})"


class _Mapping:
    def __init__(self, settings: MappingSettings, pipe: Connection) -> None:
        self._settings, self._pipe = settings, pipe
        self._state = State()  # counts of scans, placed scans and alerts
        self._stamp: float | None = None  # of the last scan
        self._track: deque[tuple[float, Placed]] = deque(maxlen=_TRACK)  # the latest placed scans, with their stamps
        # whether lost, and since which stamp [s]
        self._held: tuple[bool | None, float] = (None, 0.0)
        self._last_points = np.zeros((0, 3))  # of the last placed scan [m, sensor frame]
        self._last_sure: tuple[float, Placed] | None = None  # the last scan that was not lost, with its stamp
        self._beside = ThreadPoolExecutor(1, "deciding")
        self._deciding: Future[None] | None = None
        self._decided = self._covered = 0.0  # times of the last decision, and of the last coverage [s]
        self._counted: list[np.ndarray] = []  # points of each shown key scan, for the coverage
        self._last_arrival = time.monotonic()  # time at which the last scan came [s]
        self._stride = 1  # number of waiting scans of which the last is placed
        self._store = PointStore(_IN_MEMORY)
        self._behind = Mark()  # position in the input after the previous scan
        self._trial = ScansOnTrial()
        # number of scans when they were last examined, and stamp of the last one; None at the beginning
        self._examined: tuple[int, float] | None = None
        self._wrong = deque[Finding]()  # what is wrong with the instruments, removed when shown

    def run(self) -> None:
        kept = list(kept_keys(self._settings.out, self._alert))
        self._behind = kept[-1].behind if kept else Mark()
        self._backlog = Backlog(self._incoming(self._behind))
        self._pipe.send(messages.RESET)
        first = [key.scan for key in kept] or [each.scan for each in self._first()]
        if first:
            options = self._settings.method
            method = configure_method(first, replace(options, voxel=kept[0].voxel) if kept else options, survey=True)
            prepared = prepared_limit(method.registrar)
            with self._journal() as journal:
                key = method_key(method.name, method.setup, method.registrar)
                execution = Execution(Worker(method.registrar, prepared), journal=journal, method=key)
                mapper = Mapper(method.registrar, method.grid.voxel, self._settings.mapper, execution)
                growing = GrowingMap(mapper, self._settings.navigation)
                for each in kept:
                    growing.restore(each.scan, each.step, each.behind == Mark())
                self._map(growing)
        if self._backlog.error is not None:
            raise self._backlog.error

    def _journal(self) -> "Journal | nullcontext[None]":
        """The journal in the map's folder, or none if it cannot be written."""
        try:
            return Journal(self._settings.out / JOURNAL)
        except InputError as error:
            self._alert(f"registrations are not saved: {error}")
            return nullcontext()

    def _map(self, growing: GrowingMap) -> None:
        self._show_keys(growing)
        while not (self._backlog.ended and not self._backlog.wait(0)):
            if not self._backlog.wait(0):
                growing.idle.set()
            waiting = self._backlog.wait(_TICK)
            growing.idle.clear()
            if waiting:
                self._place(growing, waiting)
            self._decide_if_due(growing)
            self._send_state(growing)
        growing.idle.set()
        self._examine([], ended=True)
        self._end_deciding()
        self._deciding = self._beside.submit(self._decide, growing)
        self._end_deciding()
        if growing.take_over():
            self._show_poses(growing)
        self._show_keys(growing)
        self._send_state(growing, ended=self._backlog.error is None)

    def _incoming(self, after: Mark) -> Iterator[Incoming]:
        settings = self._settings
        if settings.replay is None:
            return incoming(Path(settings.inputs[0]), settings.corrections, lambda: False, after)
        return replayed(settings.inputs, settings.corrections, settings.replay, lambda: False, after)

    def _first(self) -> list[Incoming]:
        """The scans from which the voxel is chosen; empty if none has come."""
        begun = 0.0
        while not self._backlog.ended:
            waiting = self._backlog.wait(_TICK, _FIRST)
            begun = begun or (time.monotonic() if waiting else 0.0)
            if waiting >= _FIRST or (waiting and time.monotonic() - begun >= _FIRST_SECONDS):
                break
            self._send_state(None)
        return [self._backlog[k] for k in range(min(_FIRST, self._backlog.wait(0)))]

    def _place(self, growing: GrowingMap, waiting: int) -> None:
        """Place the next scan. If scans come faster than they are placed, some are skipped, which the final map uses:
        as few as possible, and none if only the next scan can be placed."""
        chosen = min(waiting, self._stride) if self._settings.replay != 0 else 1
        scan, behind = self._backlog[chosen - 1].scan, self._backlog[chosen - 1].behind
        known = len(growing.poses)
        placed = growing.add(scan, last_chance=chosen == 1)
        if placed is None and chosen > 1:
            self._stride = max(1, chosen // 2)
            return
        self._examine([self._backlog[k].scan for k in range(chosen)])
        self._backlog.drop(chosen)
        late = waiting - chosen
        self._stride = min(2 * chosen, late) if late > 1 else max(1, chosen - 1)
        for number in range(known, len(growing.poses)):
            self._keep(growing, number, behind if growing.tracker.keys[number] is scan else self._behind)
        self._behind, self._last_arrival, self._stamp = behind, time.monotonic(), scan.stamp
        self._state = replace(self._state, scans=self._state.scans + chosen)
        self._show_keys(growing)
        if placed is not None:
            self._state = replace(self._state, placed=self._state.placed + chosen)
            self._track.append((scan.stamp, placed))
            self._last_points = scan.points
            points = placed.T_key_sensor.apply(_thinned(scan.points, _LAST_SHOWN))
            self._pipe.send(messages.last(placed.key, points))

    def _keep(self, growing: GrowingMap, number: int, behind: Mark) -> None:
        """Save a key scan; its points stay in memory only if there are few."""
        step, key = growing.tracker.steps.get(number), growing.tracker.keys[number]
        try:
            growing.tracker.keys[number] = replace(key, points=self._store.keep(key.points))
            keep_key(
                self._settings.out,
                number,
                KeptKey(key, None if step is None else step.registration, behind, growing.voxel),
            )
        except (InputError, OSError) as error:
            self._alert(f"the map grows in memory only, and is lost if the mapping is killed: {error}")

    def _alert(self, words: str, remedies: Sequence[Remedy] = ()) -> None:
        """Add an alert, if none before it differs only in its numbers, which change as the map grows."""
        words, state = as_options(words), self._state
        if _without_numbers(words) not in map(_without_numbers, state.alerts):
            self._state = replace(state, alerts=(*state.alerts, words), remedies=(*state.remedies, *remedies))

    def _examine(self, scans: Sequence[Scan], ended: bool = False) -> None:
        """Put new scans on trial, and report what is wrong with the sonar from time to time."""
        for scan in scans:
            is_time = are_times(np.array([scan.stamp]))  # and not a number
            self._trial.add(scan, scan.stamp if is_time else None, span=span_of(scan))
        count, stamp = self._state.scans + len(scans), scans[-1].stamp if scans else 0.0
        before = self._examined = self._examined or (count, stamp)
        if ended or count - before[0] >= _TRIAL_SCANS or abs(stamp - before[1]) >= _TRIAL_SECONDS:
            self._examined = count, stamp
            self._wrong.extend(on_trial(Evidence(self._trial)))

    def _decide(self, growing: GrowingMap) -> None:
        """Decide, and put the instruments on trial: before by the navigation and the steps, after by all poses."""
        begun, navigation = time.perf_counter(), self._settings.navigation
        if (known := growing.known()) is None:
            return
        evidence = Evidence()
        if navigation is not None:
            axes = self._settings.corrections.frame.axes
            measured = MeasuredScans(known.keys, navigation.priors.named, navigation.place, axes)
            evidence = Evidence(of_files=navigation.faults, measured=measured, free=known.steps)
        self._wrong.extend(on_trial(evidence))
        try:
            result = growing.decide(known)
        except InputError as error:  # the journal cannot be written
            self._alert(f"registrations cannot be saved: {error}")
            growing.forget_journal()
            result = growing.decide(known)
        if len(known.steps) >= LEAST_PAIRS:
            points = (_thinned(cell_means(key.points, growing.voxel), _EXAMINED) for key in known.keys)
            self._wrong.extend(
                on_trial(replace(evidence, result=result, clouds=lambda: scan_clouds(result, [*points])))
            )
        growing.seconds = time.perf_counter() - begun

    def _end_deciding(self) -> None:
        """Wait for a running decision. If it fails, the poses still follow from the scans' steps."""
        if self._deciding is None:
            return
        try:
            self._deciding.result()
        except DeviceError:
            raise
        except Exception as error:  # noqa: BLE001 - such as wrong navigation, of which there is more later
            self._alert(f"loops are not closed: {error}")
        self._deciding, self._decided = None, time.monotonic()
        self._show_wrong()

    def _show_wrong(self) -> None:
        while self._wrong:
            self._alert(*self._wrong.popleft())

    def _decide_if_due(self, growing: GrowingMap) -> None:
        """Show the last decision, and start another in the background if enough key scans are new."""
        self._show_wrong()
        if self._deciding is not None and not self._deciding.done():
            return
        self._end_deciding()
        now = time.monotonic()
        if growing.take_over():
            self._show_poses(growing)
        new = len(growing.poses) - growing.decided
        waited = now - self._decided >= growing.seconds  # decisions take at most half of the time
        apart = growing.decided and len(growing.parts) > 1 and new > 0
        if waited and (apart or new >= max(_NEW_KEYS, _NEW_SHARE * len(growing.poses))):
            self._deciding = self._beside.submit(self._decide, growing)

    def _show_keys(self, growing: GrowingMap) -> None:
        """Send the clouds and poses of new key scans, and the coverage."""
        shown = len(self._counted)
        for number in range(shown, len(growing.poses)):
            points = growing.tracker.keys[number].points
            self._counted.append(_thinned(points, _COUNTED))
            most = min(_SHOWN, _MOST_SHOWN // (number + 1))
            cells = _without_strays(cell_means(points, growing.voxel))
            self._pipe.send(messages.cloud(number, _thinned(cells, most)))
        if shown < len(growing.poses):
            self._show_poses(growing, shown)
        if time.monotonic() - self._covered >= _COVERAGE_EVERY and growing.poses:
            self._covered = time.monotonic()
            poses, part = growing.poses, growing.poses[self._track[-1][1].key if self._track else -1].part
            own = [(poses[k].T_part_sensor, points) for k, points in enumerate(self._counted) if poses[k].part == part]
            self._pipe.send(coverage([T.apply(points)[:, :2] for T, points in own], _CELL * growing.voxel, part))

    def _show_poses(self, growing: GrowingMap, first: int = 0) -> None:
        """Send the poses of the key scans from `first` on, and, with all of them, the loops."""
        poses = growing.poses
        if first == 0:
            self._pipe.send(messages.loops(growing.loops))
        for each in messages.poses(first, poses):
            self._pipe.send(each)

    def _send_state(self, growing: GrowingMap | None, ended: bool = False) -> None:
        waiting = self._backlog.wait(0)
        last = self._backlog[waiting - 1].scan.stamp if waiting else None
        state = replace(
            self._state,
            behind=waiting,
            missing=self._backlog.missing,
            silent=0.0 if waiting else time.monotonic() - self._last_arrival,
            late=0.0 if last is None or self._stamp is None else max(0.0, last - self._stamp),
        )
        if growing is not None and self._track:
            state = self._with_vehicle(growing, state)
        self._pipe.send(replace(state, status="ended") if ended else state)

    def _with_vehicle(self, growing: GrowingMap, state: State) -> State:
        (stamp, placed), parts = self._track[-1], growing.parts
        pose = growing.pose(placed)
        T, (variances, axes) = pose.T_part_sensor, np.linalg.eigh(pose.covariance[3:, 3:])
        sigma = float(worst_sigmas(pose.covariance)[1])
        alone = len(parts) > 1 and pose.part != max(parts, key=lambda part: parts[part])
        now = stamp if self._stamp is None else self._stamp
        if not (lost := growing.tracker.is_lost or alone):
            self._last_sure = now, placed
        if lost != self._held[0]:
            self._held = lost, now
        sure = None if self._last_sure is None else growing.pose(self._last_sure[1])
        prior = growing.tracker.keys[pose.part].prior
        north, up = prior is not None and prior.knows_heading, growing.knows_up(pose.part)
        forward = T.rotation.apply([1.0, 0.0, 0.0]) * [1.0, 1.0, 0.0 if up else 1.0]
        ahead = T.rotation.apply(forward / max(float(np.linalg.norm(forward)), 1e-9), inverse=True)
        turned = np.degrees(np.arctan2(*(forward[:2] if north else forward[1::-1] * [-1.0, 1.0])))
        return replace(
            state,
            status="lost" if lost else "uncertain" if sigma > _UNSURE * growing.voxel else "placed",
            keys=len(growing.poses),
            loops=len(growing.loops),
            parts=len(parts),
            alone=alone,
            lost_for=now - self._last_sure[0] if lost and self._last_sure else None,
            sigma=sigma,
            part=pose.part,
            own=growing.settled,
            stamp=stamp,
            pose=messages.seven(T),
            half_axes=T.rotation.apply((axes * np.sqrt(variances.clip(0))).T).tolist(),
            sure=None if sure is None else (sure.part, sure.T_part_sensor.translation.round(4).tolist()),
            held=now - self._held[1],
            depth=-float(T.translation[2]) if up else None,
            speed=self._speed(growing),
            heading=float(turned) % 360,
            north=north,
            altitude=self._altitude(growing, pose) if up else None,
            ahead=clearance(self._last_points, ahead, growing.voxel),
        )

    def _altitude(self, growing: GrowingMap, pose: Pose) -> float | None:
        """Height [m] over what key scans near the vehicle saw below it."""
        place = pose.T_part_sensor.translation
        own = [(each.T_part_sensor, k) for k, each in enumerate(growing.poses) if each.part == pose.part]
        nearest = nsmallest(_BESIDE, own, lambda each: float(np.linalg.norm(each[0].translation - place)))
        points = np.concatenate([T.apply(self._counted[k]) for T, k in nearest]) - place
        return clearance(points, np.array([0.0, 0.0, -1.0]), growing.voxel)

    def _speed(self, growing: GrowingMap) -> float | None:
        """Speed [m/s] over the last seconds; None if unknown."""
        last, part = self._track[-1][0], growing.poses[self._track[-1][1].key].part
        within = [
            (stamp, growing.pose(placed).T_part_sensor)
            for stamp, placed in self._track
            if last - stamp <= _SPEED_OVER and growing.poses[placed.key].part == part
        ]
        span = last - within[0][0]
        return float(np.linalg.norm(within[-1][1].translation - within[0][1].translation)) / span if span > 0 else None


def _without_numbers(words: str) -> str:
    return re.sub(r"\d+", "", words)


def _without_strays(points: np.ndarray) -> np.ndarray:
    """Of points (N, 3) [m] in the sensor frame, those that have others close to them, as the sensor sees them."""
    apart = KDTree(points).query(points, [1 + _COMPANY])[0][:, 0]
    return points[apart < _CLOSE * np.linalg.norm(points, axis=1)]


def _thinned(points: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of (N, 3) points, evenly chosen."""
    return points[:: max(1, -(-len(points) // most))]


_MOST = 256  # scans in memory; the others stay in their file


class Backlog:
    """Reads scans in a thread of its own, and holds those that wait to be placed."""

    def __init__(self, scans: Iterable[Incoming]) -> None:
        self.error: InputError | None = None  # why no more scans come
        self.missing = 0  # missing shots, by their numbers
        self.ended = False  # whether no more scans come
        self._waiting: deque[Incoming] = deque()
        self._changed = Condition()
        Thread(target=self._run, args=(scans,), name="incoming", daemon=True).start()

    def wait(self, seconds: float, least: int = 1) -> int:
        """Number of waiting scans, once it is `least`, no more scans come, or the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._waiting) >= least or self.ended, seconds)
            return len(self._waiting)

    def __getitem__(self, number: int) -> Incoming:
        with self._changed:
            return self._waiting[number]

    def drop(self, count: int) -> None:
        """Remove the first scans."""
        with self._changed:
            for _ in range(min(count, len(self._waiting))):
                self._waiting.popleft()
            self._changed.notify_all()

    def _run(self, scans: Iterable[Incoming]) -> None:
        try:
            for each in scans:
                with self._changed:
                    self._changed.wait_for(lambda: len(self._waiting) < _MOST)
                    self._waiting.append(each)
                    self.missing = each.missing
                    self._changed.notify_all()
        except BaseException as error:  # noqa: BLE001 - `error` reports it to whoever waits for scans
            self.error = error if isinstance(error, InputError) else InputError(f"scans cannot be read: {error!r}")
        finally:
            with self._changed:
                self.ended = True
                self._changed.notify_all()
