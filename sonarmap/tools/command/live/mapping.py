# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The process that maps: scans in as they come, messages for the page out."""

import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.graph.tangent import worst_sigmas
from sonarmap.slam.live.growing import GrowingMap
from sonarmap.slam.live.tracker import Placed
from sonarmap.slam.map.cell import cell_means
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.spectral.point_store import PointStore
from sonarmap.tools.command.live.backlog import Backlog
from sonarmap.tools.command.live.kept_keys import KeptKey, keep_key, kept_keys
from sonarmap.tools.command.live.words import Standing, sentence
from sonarmap.tools.command.method import configure_method
from sonarmap.tools.command.options.registration import MethodOptions
from sonarmap.tools.files.map_folder.names import JOURNAL
from sonarmap.tools.files.readers.corrections import Corrections
from sonarmap.tools.files.readers.incoming import Incoming, Mark, incoming, replayed
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.products.live import messages

_FIRST = 10  # scans that choose the voxel, or those of so many seconds
_FIRST_SECONDS = 3.0
_TICK = 1.0  # between states where no scan comes [s]
_UNSURE = 8.0  # standard deviation of a place that is uncertain [voxels]: as far as key scans are apart
_SHOWN, _LAST_SHOWN, _COUNTED = 4000, 2500, 1000  # points: of a key scan, of the last scan, for the coverage
_CELL = 4.0  # edge of a cell of the coverage [voxels]
_COVERAGE_EVERY = 2.0  # [s]
_NEW_KEYS, _NEW_SHARE = 4, 0.1  # key scans after which all is decided anew, and their share of all
_SPEED_OVER = 2.0  # [s]
_TRACK = 64  # scans that tell the speed
_IN_MEMORY = 1 << 27  # bytes of key scans; the others are on disk


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """What is mapped, and how."""

    out: Path  # the map's folder
    inputs: tuple[str, ...]  # one that grows, or finished ones to replay
    replay: float | None  # so many times faster than they were taken, 0 at once; None of one that grows
    corrections: Corrections
    method: MethodOptions
    mapper: MapperSettings


def run_mapping(settings: MappingSettings, pipe: Connection) -> None:
    """Map until the input has ended, or nobody reads the pipe any more; what is to be shown goes through it.

    Sends str and bytes of `tools.products.live.messages`, and None at the end, when all that came is placed.
    """
    signal(SIGINT, SIG_IGN)  # it is for who shows
    try:
        _Mapping(settings, pipe).run()
        pipe.send(None)
    except (BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        pass  # the one who shows has gone; who comes next goes on
    except (InputError, DeviceError) as error:
        pipe.send(error)


@dataclass(slots=True)
class _Count:
    """What came of the scans so far."""

    scans: int = 0
    placed: int = 0
    stamp: float | None = None  # of the last one
    sure: float | None = None  # of the last scan whose place was sure


class _Mapping:
    def __init__(self, settings: MappingSettings, pipe: Connection) -> None:
        self._settings, self._pipe = settings, pipe
        self._count = _Count()
        self._track: deque[tuple[float, Placed]] = deque(maxlen=_TRACK)
        self._beside = ThreadPoolExecutor(1, "deciding")
        self._deciding: Future[None] | None = None
        self._decided = self._covered = 0.0  # when all was decided, and the coverage was sent
        self._shown = 0  # key scans of which clouds were sent
        self._counted: list[np.ndarray] = []  # points of each
        self._vehicle: Placed | None = None
        self._sure: Placed | None = None
        self._heard = time.monotonic()  # when the last scan came
        self._stride = 1
        self._store = PointStore(_IN_MEMORY)
        self._behind = Mark()  # how far the input was read for the scan before

    def run(self) -> None:
        """As `run_mapping`."""
        kept = list(kept_keys(self._settings.out))
        self._behind = kept[-1].behind if kept else Mark()
        self._backlog = Backlog(self._incoming(self._behind))
        self._pipe.send(messages.reset_message())
        first = [key.scan for key in kept] or [each.scan for each in self._first()]
        if first:
            options = self._settings.method
            method = configure_method(first, replace(options, voxel=kept[0].voxel) if kept else options, survey=True)
            prepared = prepared_limit(method.registrar)
            with Journal(self._settings.out / JOURNAL) as journal:
                key = method_key(method.name, method.setup, method.registrar)
                execution = Execution(Worker(method.registrar, prepared), journal=journal, method=key)
                mapper = Mapper(method.registrar, method.grid.voxel, self._settings.mapper, execution)
                growing = GrowingMap(mapper)
                for each in kept:
                    growing.restore(each.scan, each.step, each.behind == Mark())
                self._map(growing)
        if self._backlog.error is not None:
            raise self._backlog.error

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
            self._say(growing)
        growing.idle.set()
        if self._deciding is not None:
            self._deciding.result()
        growing.decide()
        if growing.take_over():
            self._show_poses(growing)
        self._show_keys(growing)
        self._say(growing, ended=True)

    def _incoming(self, after: Mark) -> Iterator[Incoming]:
        settings = self._settings
        if settings.replay is None:
            return incoming(Path(settings.inputs[0]), settings.corrections, lambda: False, after)
        return replayed(settings.inputs, settings.corrections, settings.replay, lambda: False, after)

    def _first(self) -> list[Incoming]:
        """The scans that choose the voxel; none if none has come."""
        begun = 0.0
        while not self._backlog.ended:
            waiting = self._backlog.wait(_TICK, _FIRST)
            begun = begun or (time.monotonic() if waiting else 0.0)
            if waiting >= _FIRST or (waiting and time.monotonic() - begun >= _FIRST_SECONDS):
                break
            self._say(None)
        return self._backlog.first(_FIRST)

    def _place(self, growing: GrowingMap, waiting: int) -> None:
        """Place the next scan. Where more wait than can be placed, some are left for the map that is made at the end:
        as few as keep up, and none where the next one alone can be placed."""
        chosen = min(waiting, self._stride) if self._settings.replay != 0 else 1
        scan, behind = self._backlog[chosen - 1].scan, self._backlog[chosen - 1].behind
        keys = len(growing.poses)
        placed = growing.add(scan, last_chance=chosen == 1)
        if placed is None and chosen > 1:
            self._stride = max(1, chosen // 2)
            return
        self._backlog.drop(chosen)
        late = waiting - chosen
        self._stride = min(2 * chosen, late) if late > 1 else max(1, chosen - 1)
        for number in range(keys, len(growing.poses)):
            step, key = growing.tracker.steps.get(number), growing.tracker.keys[number]
            growing.tracker.keys[number] = replace(key, points=self._store.keep(key.points))
            mark = behind if key is scan else self._behind  # of a scan before
            keep_key(self._settings.out, number, KeptKey(key, step and step.registration, mark, growing.voxel))
        self._behind = behind
        count, self._heard = self._count, time.monotonic()
        count.scans, count.stamp = count.scans + chosen, scan.stamp
        self._show_keys(growing)
        if placed is None:
            return
        count.placed += chosen
        self._vehicle = placed
        self._track.append((scan.stamp, placed))
        T = placed.T_key_sensor
        self._pipe.send(messages.track_message([placed.key], T.translation[None]))
        self._pipe.send(messages.last_message(placed.key, T.apply(_thinned(scan.points, _LAST_SHOWN))))

    def _decide_if_due(self, growing: GrowingMap) -> None:
        """Decide all anew, beside, where enough is new; and show what came of it."""
        if self._deciding is not None and not self._deciding.done():
            return
        now = time.monotonic()
        if self._deciding is not None:
            self._deciding.result()  # or what it ended by
            self._deciding, self._decided = None, now
        if growing.take_over():
            self._show_poses(growing)
        new = len(growing.poses) - growing.decided
        waited = now - self._decided >= growing.seconds  # half of the time at most is for this
        apart = growing.decided and len(growing.parts) > 1 and new > 0
        if waited and (apart or new >= max(_NEW_KEYS, _NEW_SHARE * len(growing.poses))):
            self._deciding = self._beside.submit(growing.decide)

    def _show_keys(self, growing: GrowingMap) -> None:
        """Clouds and poses of key scans that are new."""
        for number in range(self._shown, len(growing.poses)):
            points = growing.tracker.keys[number].points
            self._counted.append(_thinned(points, _COUNTED))
            self._pipe.send(messages.cloud_message(number, _thinned(cell_means(points, growing.voxel), _SHOWN)))
        if self._shown < len(growing.poses):
            self._show_poses(growing, self._shown)
        self._shown = len(growing.poses)
        if time.monotonic() - self._covered >= _COVERAGE_EVERY and growing.poses:
            self._covered = time.monotonic()
            self._pipe.send(self._coverage(growing))

    def _show_poses(self, growing: GrowingMap, first: int = 0) -> None:
        poses = growing.poses
        if first == 0:
            self._pipe.send(messages.loops_message(growing.loops))
        shown = [_seven(pose.T_part_sensor) for pose in poses[first:]]
        self._pipe.send(messages.poses_message(first, [pose.part for pose in poses[first:]], shown))

    def _coverage(self, growing: GrowingMap) -> bytes:
        """How often the plan of the vehicle's part was seen, by key scans."""
        poses, cell = growing.poses, _CELL * growing.voxel
        part = poses[self._vehicle.key if self._vehicle else -1].part
        seen: list[np.ndarray] = []
        for pose, points in zip(poses, self._counted, strict=False):
            if pose.part == part:
                own = np.floor(pose.T_part_sensor.apply(points)[:, :2] / cell).astype(np.int64)
                own, often = np.unique(own, axis=0, return_counts=True)
                seen.append(own[often > 1])  # a single point may be a stray echo
        cells, counts = np.unique(np.concatenate(seen), axis=0, return_counts=True)
        if not len(cells):
            return messages.coverage_message(np.zeros((1, 1)), cell, (0.0, 0.0), part)
        low = np.quantile(cells, 0.001, axis=0).astype(np.int64)
        size = np.quantile(cells, 0.999, axis=0).astype(np.int64) - low + 1
        near = ((cells >= low) & (cells < low + size)).all(axis=1)
        grid = np.zeros(size[::-1], np.int64)
        x, y = (cells[near] - low).T
        grid[y, x] = counts[near]
        corner = low * cell
        return messages.coverage_message(grid, cell, (float(corner[0]), float(corner[1])), part)

    def _say(self, growing: GrowingMap | None, ended: bool = False) -> None:
        """The state."""
        count, placed = self._count, self._vehicle
        waiting = self._backlog.wait(0)
        last = self._backlog[waiting - 1].scan.stamp if waiting else None
        silent = 0.0 if waiting else time.monotonic() - self._heard
        standing = Standing(
            count.scans, count.placed, behind=waiting, missing=self._backlog.missing, silent=silent,
            late=max(0.0, last - count.stamp) if last is not None and count.stamp is not None else 0.0,
        )  # fmt: skip
        if growing is None or placed is None or count.stamp is None:
            self._pipe.send(messages.state_message(messages.State("waiting", sentence("waiting", standing))))
            return
        pose, parts = growing.pose(placed), growing.parts
        alone = len(parts) > 1 and pose.part != max(parts, key=lambda part: parts[part])
        sigma = float(worst_sigmas(pose.covariance)[1])
        if growing.tracker.is_lost or alone:
            status = "lost"
        else:
            status = "uncertain" if sigma > _UNSURE * growing.voxel else "placed"
            count.sure, self._sure = count.stamp, placed
        standing = replace(
            standing, loops=len(growing.loops), parts=len(parts), alone=alone, sigma=sigma,
            lost_for=None if count.sure is None else count.stamp - count.sure,
        )  # fmt: skip
        status = "ended" if ended else status
        speed, turn_rate = self._speeds(growing)
        R = pose.T_part_sensor.rotation.as_matrix()
        sure = None if self._sure is None else growing.pose(self._sure)
        level = growing.knows_up(pose.part)
        state = messages.State(
            status=status,
            sentence=sentence(status, standing),
            stamp=count.stamp,
            scans=count.scans,
            placed=count.placed,
            keys=len(growing.poses),
            loops=len(growing.loops),
            parts=len(parts),
            behind=waiting,
            lost_since=standing.lost_for if status == "lost" else None,
            vehicle=messages.Vehicle(placed.key, _seven(pose.T_part_sensor), R @ pose.covariance[3:, 3:] @ R.T),
            part=pose.part,
            depth=-float(pose.T_part_sensor.translation[2]) if level else None,
            speed=speed,
            turn_rate=turn_rate,
            last_sure=None if sure is None else messages.LastSure(sure.part, sure.T_part_sensor.translation),
        )
        self._pipe.send(messages.state_message(state))

    def _speeds(self, growing: GrowingMap) -> tuple[float | None, float | None]:
        """Speed [m/s] and turn rate [deg/s], positive to the left, of the last seconds."""
        if not self._track:
            return None, None
        (last, placed), part = self._track[-1], growing.poses[self._track[-1][1].key].part
        within = [
            each for each in self._track if last - each[0] <= _SPEED_OVER and growing.poses[each[1].key].part == part
        ]
        span = last - within[0][0]
        if not span > 0:
            return None, None
        T = growing.pose(within[0][1]).T_part_sensor.inv() * growing.pose(placed).T_part_sensor
        turn = T.rotation.as_rotvec()[2]
        return float(np.linalg.norm(T.translation)) / span, float(np.degrees(turn)) / span


def _thinned(points: np.ndarray, most: int) -> np.ndarray:
    """At most so many of (N, 3) points, evenly."""
    return points[:: max(1, -(-len(points) // most))]


def _seven(T: RigidTransform) -> np.ndarray:
    """x, y, z [m] and the quaternion x, y, z, w."""
    return np.concatenate([T.translation, T.rotation.as_quat()])
