"""The sonar's own IMU: which way is down, as roll and pitch of a shot, and turn rates.

Specific forces (at rest gravity, pointing up) and turn rates are taken to have the axes of the sonar's images,
x forward, y right, z down; the protocol does not say. They are turned here, once, to x forward, y left, z up.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.sonar.messages import Remembered, message_of
from sonarmap.tools.files.readers.sonar.packets import Damage, packets_in

_FLIP = np.array([1.0, -1.0, -1.0])  # to x forward, y left, z up
_GRAVITY = 9.81  # [m/s^2]; 9.78 to 9.83 on Earth
_AROUND = 0.5  # samples this long before and after a shot are averaged [s]
_NEAR = 0.1  # one of them is at least so near [s]
_LEAST = 10  # samples
_PARTS = 5  # of the samples, whose means show how much the vehicle accelerates
_MOST_UNSTEADY = 0.05  # share of gravity; a vehicle that accelerates more has no attitude from this
_UNSEEN = np.deg2rad(1.5)  # of roll and pitch: a small accelerometer is off by 0.02 g, slow waves accelerate as much
_HELD = 8192  # samples


@dataclass(frozen=True, slots=True)
class ImuSamples:
    times: np.ndarray  # (n,) float64 [s, UTC]
    forces: np.ndarray  # (n, 3) float64 specific force [m/s^2], x forward, y left, z up
    rates: np.ndarray  # (n, 3) float64 turn rates [rad/s], about the same axes


def _joined(parts: Sequence[ImuSamples]) -> ImuSamples:
    return ImuSamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in ImuSamples.__slots__))


def samples_of(batch: rip.ImuBatch) -> ImuSamples:
    """The samples of a message. Raises InputError: their numbers contradict each other, or are not finite."""
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
    """The latest samples of a recording that is being read, and the attitude that they give a shot among them."""

    def __init__(self) -> None:
        self._batches: deque[tuple[float, float, ImuSamples]] = deque()  # with their first and last time
        self._held = 0

    def add(self, samples: ImuSamples) -> None:
        if not len(samples.times):
            return
        self._batches.append((float(samples.times.min()), float(samples.times.max()), samples))
        self._held += len(samples.times)
        while self._held > _HELD and len(self._batches) > 1:
            self._held -= len(self._batches.popleft()[2].times)

    def prior_at(self, stamp: float | None) -> PosePrior | None:
        """Roll and pitch at a time [s]; None where too few samples are near it, or the vehicle accelerates."""
        if stamp is None:
            return None
        low, high = stamp - _AROUND, stamp + _AROUND
        near = [samples for first, last, samples in self._batches if first <= high and last >= low]
        if not near:
            return None
        samples = _joined(near)
        order = np.argsort(samples.times, kind="stable")
        order = order[np.abs(samples.times[order] - stamp) <= _AROUND]
        return attitude_at(stamp, ImuSamples(samples.times[order], samples.forces[order], samples.rates[order]))


def attitude_at(stamp: float, samples: ImuSamples) -> PosePrior | None:
    """Roll and pitch at a time [s], from ascending samples around it; None where they do not tell. Each force is turned
    to the sensor's frame at that time by the turn rates in between, and their mean points up. What means of five parts
    scatter, and what the mean's length is off gravity, is acceleration, and part of the standard deviation, beside what
    neither shows."""
    times, forces = samples.times, samples.forces
    if len(times) < _LEAST or np.abs(times - stamp).min() > _NEAR:
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
    if max(off, unsteady) > _MOST_UNSTEADY:
        return None
    # The third row of R_world_sensor is up, seen from the sensor: (-sin pitch, cos pitch sin roll, cos pitch cos roll)
    pitch, roll = -np.arcsin(np.clip(up[0], -1, 1)), np.arctan2(up[1], up[2])
    sigma = float(np.sqrt(_UNSEEN**2 + unsteady**2 + off**2))
    R_world_sensor = Rotation.from_euler("ZYX", [0.0, pitch, roll])
    return PosePrior(RigidTransform.from_rotation(R_world_sensor), np.array([sigma] * 2 + [np.inf] * 4))


def turn_rates(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The turn rates that the IMU of a `.sonar` file measured: times (n,) [s, UTC by the sonar's clock], ascending, and
    rates (n, 3) [rad/s] about x forward, y left, z up. Raises InputError: the file cannot be read, or has no batch."""
    batches: list[ImuSamples] = []
    seen = Remembered()
    for packet in packets_in(path, Damage()):
        try:
            message = message_of(packet.content, rip.ImuBatch)
            if not isinstance(message, rip.ImuBatch):
                continue
            samples = samples_of(message)
        except InputError:
            continue  # told where the recording is read
        if seen.is_new(batch_key(message, samples)):
            batches.append(samples)
    if not any(len(batch.times) for batch in batches):
        raise InputError(f"{path}: no IMU batch in it; record with the output of IMU batches enabled")
    samples = _joined(batches)
    times, first = np.unique(samples.times, return_index=True)
    return times, samples.rates[first]


def batch_key(batch: rip.ImuBatch, samples: ImuSamples) -> tuple[int, float | None]:
    """What tells a batch from others: its number, and its first time."""
    return batch.batch_sequence_id, float(samples.times[0]) if len(samples.times) else None
