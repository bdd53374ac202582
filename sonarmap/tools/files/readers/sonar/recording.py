"""Reader of a recording of the Water Linked Sonar 3D-15 (.sonar): one cloud per shot, in order.

Lost, damaged and late packets are counted.
"""

from array import array
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from google.protobuf.message import Message
from scipy.spatial.transform import RigidTransform, Rotation
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.sonar.messages import (
    REACH,
    STRENGTH,
    WAITING,
    Remembered,
    Shot,
    ShotNumbers,
    ShotQueue,
    frame_of,
    message_of,
)
from sonarmap.tools.files.readers.sonar.packets import Damage, no_more, packets_in
from sonarmap.tools.files.time_scales import clock_faults, clock_of

_SAME_SPEED = 0.05  # [m/s], differences that are no change of the speed of sound
_JUMP = 1.0  # [s], least jump of the clock relative to the numbers of the shots
_FLIP = np.array([1.0, -1.0, -1.0])  # to x forward, y left, z up
_GRAVITY = 9.81  # [m/s^2]; 9.78 to 9.83 on Earth
_AROUND = 0.5  # [s], before and after a shot, in which samples are averaged
_NEAR = 0.1  # [s], largest distance of the nearest sample
_MIN_SAMPLES = 10
_PARTS = 5  # of the samples, whose means show the vehicle's acceleration
_MAX_ACCELERATION = 0.05  # share of gravity, up to which samples give an attitude
_MIN_SIGMA = np.deg2rad(1.5)  # of roll and pitch: small accelerometers err by 0.02 g, and slow waves accelerate as much
_HELD = 8192  # samples that are kept


@dataclass(frozen=True, slots=True)
class ImuSamples:
    times: np.ndarray  # (n,) float64 [s, UTC]
    forces: np.ndarray  # (n, 3) float64 specific force [m/s^2], x forward, y left, z up
    rates: np.ndarray  # (n, 3) float64 turn rates [rad/s] about the same axes


def _joined(parts: Iterable[ImuSamples]) -> ImuSamples:
    return ImuSamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in ImuSamples.__slots__))


def samples_of(batch: rip.ImuBatch) -> ImuSamples:
    """The samples of a message, in ImuSamples' axes."""
    times = np.array([time.seconds + time.nanos * 1e-9 for time in batch.timestamp])
    forces, rates = (np.array(values, dtype=np.float64) for values in (batch.specific_force, batch.rate_of_turn))
    if not len(times) == batch.samples == len(forces) / 3 == len(rates) / 3:
        raise InputError(
            f"is an IMU batch of {batch.samples:,} samples with {len(times):,} times, {len(forces):,} forces and "
            f"{len(rates):,} turn rates"
        )
    if not (np.isfinite(forces).all() and np.isfinite(rates).all()):
        raise InputError("is an IMU batch with numbers that are not finite")
    return ImuSamples(times, forces.reshape(-1, 3) * _FLIP, rates.reshape(-1, 3) * _FLIP)


class ImuWindow:
    """The latest samples of a recording that is being read, from which the attitude of a shot is computed."""

    def __init__(self) -> None:
        self._batches: deque[ImuSamples] = deque()
        self._held = 0

    def add(self, samples: ImuSamples) -> None:
        if not len(samples.times):
            return
        self._batches.append(samples)
        self._held += len(samples.times)
        while self._held > _HELD and len(self._batches) > 1:
            self._held -= len(self._batches.popleft().times)

    def prior_at(self, stamp: float | None) -> PosePrior | None:
        """Roll and pitch at a stamp [s]; None if too few samples are near it, or the vehicle accelerates too much."""
        if stamp is None or not self._batches:
            return None
        samples = _joined(self._batches)
        near = np.flatnonzero(np.abs(samples.times - stamp) <= _AROUND)
        near = near[np.argsort(samples.times[near], kind="stable")]
        return attitude_at(stamp, ImuSamples(samples.times[near], samples.forces[near], samples.rates[near]))


def attitude_at(stamp: float, samples: ImuSamples) -> PosePrior | None:
    """Roll and pitch at a stamp [s], from ascending samples around it; None if there are too few or the vehicle
    accelerates too much. The turn rates rotate each force to the sensor's frame at the stamp; the mean force points up.
    The scatter of the means of five parts, and the difference of the mean's length from gravity, measure acceleration;
    both are added in quadrature to the smallest standard deviation."""
    times, forces = samples.times, samples.forces
    if len(times) < _MIN_SAMPLES or np.abs(times - stamp).min() > _NEAR:
        return None
    steps = np.diff(times)[:, None] * (samples.rates[1:] + samples.rates[:-1]) / 2
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    nearest = int(np.argmin(np.abs(times - stamp)))
    turned -= turned[nearest] + (stamp - times[nearest]) * samples.rates[nearest]
    forces = Rotation.from_rotvec(turned).apply(forces)  # R_shot_sample
    mean = forces.mean(axis=0)
    size = float(np.linalg.norm(mean))
    off = abs(size - _GRAVITY) / _GRAVITY
    if size == 0:
        return None
    up = mean / size
    parts = np.array([part.mean(axis=0) for part in np.array_split(forces, _PARTS)])
    sideways = parts - parts @ up[:, None] * up
    unsteady = float(np.sqrt((sideways**2).sum(axis=1).mean() / 2)) / _GRAVITY
    if max(off, unsteady) > _MAX_ACCELERATION:
        return None
    # The third row of R_world_sensor is up in the sensor's frame: (-sin pitch, cos pitch sin roll, cos pitch cos roll)
    pitch, roll = -np.arcsin(np.clip(up[0], -1, 1)), np.arctan2(up[1], up[2])
    sigma = float(np.sqrt(_MIN_SIGMA**2 + unsteady**2 + off**2))
    R_world_sensor = Rotation.from_euler("ZYX", [0.0, pitch, roll])
    return PosePrior(RigidTransform.from_rotation(R_world_sensor), np.array([sigma] * 2 + [np.inf] * 4))


def turn_rates(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Turn rates of the IMU in a `.sonar` file: times (n,) [s, UTC by the sonar's clock], ascending, and rates (n, 3)
    [rad/s] about x forward, y left, z up."""
    batches: list[ImuSamples] = []
    seen = Remembered()
    for packet in packets_in(path, Damage()):
        try:
            message = message_of(packet.content, rip.ImuBatch)
            if not isinstance(message, rip.ImuBatch):
                continue
            samples = samples_of(message)
        except InputError:
            continue  # reported by `Recording.read`
        if seen.is_new(batch_key(message, samples)):
            batches.append(samples)
    if not any(len(batch.times) for batch in batches):
        raise InputError(f"{path}: no IMU batch in it; record with the output of IMU batches enabled")
    samples = _joined(batches)
    times, first = np.unique(samples.times, return_index=True)
    return times, samples.rates[first]


def batch_key(batch: rip.ImuBatch, samples: ImuSamples) -> tuple[int, float | None]:
    """The key of a batch, which recognizes duplicates: its number and first time."""
    return batch.batch_sequence_id, float(samples.times[0]) if len(samples.times) else None


@dataclass(slots=True)
class Recording:
    """State and counts of a recording that is being read."""

    packets: int = 0  # good packets of any kind
    shots: int = 0  # range images without duplicates
    bare: int = 0  # shots without a strength image
    doubled_batches: int = 0  # duplicate batches of the IMU
    damage: Damage = field(default_factory=Damage)  # packets that could not be read
    read_until: int = 0  # the byte after the last packet
    queue: ShotQueue = field(default_factory=ShotQueue)  # also counts doubled, missing and late images
    batches: ShotNumbers = field(default_factory=ShotNumbers)  # counts missing batches of the IMU
    imu: ImuWindow = field(default_factory=ImuWindow)  # its latest samples
    speeds: tuple[float, float, int] | None = None  # lowest and highest speed of sound [m/s], and number of changes
    _seen: Remembered = field(default_factory=Remembered)
    _speed: float | None = None
    _stamps: array = field(default_factory=lambda: array("d"))
    _places: array = field(default_factory=lambda: array("q"))

    def read(
        self, path: Path, waiting: int = WAITING, more: Callable[[], bool] = no_more, start: int = 0
    ) -> Iterator[Shot]:
        """Every shot in order, each as soon as `waiting` shots have come after it; `more` and `start` as of
        `packets_in`."""
        kinds = (rip.RangeImage, rip.BitmapImageGreyscale8, rip.ImuBatch)
        for packet in packets_in(path, self.damage, more, start):
            try:
                self.packets, self.read_until = self.packets + 1, packet.start + len(packet.content)
                message = message_of(packet.content, *kinds)
                if message is not None:
                    self._take(message)
            except InputError as error:
                self.damage.add(packet.number, packet.start, len(packet.content), str(error))
            yield from map(self._counted, self.queue.shots(waiting))
        yield from map(self._counted, self.queue.rest())

    def _take(self, message: Message) -> None:
        if isinstance(message, rip.RangeImage):
            self.queue.add_frame(frame_of(message))
        elif isinstance(message, rip.BitmapImageGreyscale8):
            if message.type == STRENGTH:
                self.queue.add_strength(message)
        elif isinstance(message, rip.ImuBatch):
            samples = samples_of(message)
            key = batch_key(message, samples)
            if self._seen.is_new(key):
                self.batches.place(*key)
                self.imu.add(samples)
            else:
                self.doubled_batches += 1

    def cloud(self, shot: Shot) -> Cloud:
        """The cloud of a shot, with its attitude from the IMU samples read before it."""
        frame, prior = shot.frame, self.imu.prior_at(shot.frame.stamp)
        return Cloud(frame.points, shot.strength, frame.stamp, prior=prior, sound_speed=frame.sound_speed)

    def _counted(self, shot: Shot) -> Shot:
        self.shots += 1
        self.bare += shot.strength is None
        if shot.frame.stamp is not None:
            self._stamps.append(shot.frame.stamp)
            self._places.append(shot.place)
        speed = shot.frame.sound_speed
        if speed is not None:
            low, high, changes = self.speeds or (speed, speed, 0)
            changed = self._speed is not None and abs(speed - self._speed) > _SAME_SPEED
            self.speeds, self._speed = (min(low, speed), max(high, speed), changes + changed), speed
        return shot

    def notes(self, changed: float | None = None) -> list[str]:
        """Notes for the user on the recording as a whole. `changed`: when the file was last changed [s, UTC]."""
        damage, queue, numbers = self.damage, self.queue, self.queue.numbers
        missing, total, batches = numbers.missing, self.shots + numbers.missing, self.batches.missing
        which = "" if damage.packets == 1 else "the first is "
        low, high, changes = self.speeds or (0.0, 0.0, 0)
        rows = [
            (damage.packets, f"{counted(damage.packets, 'damaged packet')} left out, {damage.size:,} bytes: {which}"
             f"{damage.first}"),
            (damage.cut, f"the recording is cut: of its last packet there are only {counted(damage.cut, 'byte')}"),
            (missing, f"{missing:,} of {total:,} shots are missing by their numbers"),
            (queue.doubled, f"{counted(queue.doubled, 'doubled image')} left out"),
            (numbers.late, f"{counted(numbers.late, 'shot')} came late, now in order"),
            (numbers.wraps, f"the numbers of the shots wrapped {_times(numbers.wraps)}, at 2^32"),
            (numbers.restarts, f"the numbers of the shots start again {_times(numbers.restarts)}: the sonar was "
             "restarted, or recordings were put together"),
            (batches, f"{counted(batches, 'batch', 'batches')} of the IMU missing by their numbers"),
            (self.doubled_batches, f"{counted(self.doubled_batches, 'doubled batch', 'doubled batches')} of the IMU "
             "left out"),
            (self.bare < self.shots and self.bare, f"{self.bare:,} of {counted(self.shots, 'shot')} have no strength "
             "image"),
            (queue.alone, f"{counted(queue.alone, 'strength image')} left out, without a range image of the same "
             "shot"),
            (changes, f"the speed of sound changes {_times(changes)}, between {low:.1f} and {high:.1f} m/s"),
        ]  # fmt: skip
        return [note for count, note in rows if count] + list(self._clock_notes(changed))

    def _clock_notes(self, changed: float | None) -> Iterator[str]:
        if not self._stamps:
            return
        yield from clock_faults(clock_of(np.array(self._stamps, dtype=np.float64)), changed)
        jumps, largest = self._jumps()
        if jumps:
            yield (
                f"the clock jumps {_times(jumps)} against the numbers of the shots, by up to {largest:.1f} s: it was "
                "set, or the sonar paused"
            )

    def _jumps(self) -> tuple[int, float]:
        """Number of jumps of the clock relative to the numbers of the shots, and the largest one [s]."""
        numbers = np.diff(np.array(self._places, dtype=np.float64))
        times = np.diff(np.array(self._stamps, dtype=np.float64))
        known = (numbers > 0) & (numbers <= REACH)
        if not known.any():
            return 0, 0.0
        period = float(np.median(times[known] / numbers[known]))
        off = np.abs(times[known] - numbers[known] * period)
        jumped = off > max(_JUMP, 3 * period)
        return int(jumped.sum()), float(off[jumped].max(initial=0.0))


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number:,} times"


def stream_sonar(path: Path, notes: list[str]) -> Iterator[Cloud]:
    """One cloud per range image, in the order of the shots, empty without an echo. Lost, doubled, damaged and late
    packets are added to `notes` when all is read."""
    recording = Recording()
    for shot in recording.read(path):
        yield recording.cloud(shot)
    if not recording.shots:
        first = recording.damage.first
        raise InputError(
            f"no range image can be read; {first}: copy the recording again"
            if first
            else f"no range image among its {recording.packets:,} packets; record with range images enabled"
        )
    notes += [f"{path.name}: {note}" for note in recording.notes(path.stat().st_mtime)]
