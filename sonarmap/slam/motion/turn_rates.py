"""Turn rates that a gyroscope measured, and the sensor's rotation by them at any time."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError

_ROUNDS = 2  # of estimating the bias
_MIN_SAMPLES = 3  # that have second differences
_MAX_GAP = 0.5  # between samples [median intervals of the scans]


@dataclass(frozen=True, slots=True)
class TurnRates:
    """Measured turn rates.

    Attributes:
        times: (m,) [s], by the clock of the scans' stamps, ascending.
        rates: (m, 3) [rad/s], about the axes of the sensor's frame.

    Raises:
        InputError: fewer than two, other shapes, numbers that are not finite, or times that do not ascend.
    """

    times: np.ndarray
    rates: np.ndarray

    def __post_init__(self) -> None:
        times, rates = self.times, self.rates
        fits = times.ndim == 1 and len(times) > 1 and rates.shape == (len(times), 3)
        if not (fits and np.isfinite(rates).all() and (np.diff(times) > 0).all()):
            raise InputError(
                f"turn rates of shape {rates.shape} at times of shape {times.shape}; wanted (m, 3) and (m,), two or "
                "more, all finite, the times ascending"
            )

    def cover(self, stamps: np.ndarray) -> bool:
        """Whether the samples cover (n,) ascending stamps [s] without a long gap."""
        first, last = np.searchsorted(self.times, stamps[[0, -1]])
        known = np.clip(self.times[max(first - 1, 0) : last + 1], stamps[0], stamps[-1])
        gaps = np.diff(np.concatenate([stamps[:1], known, stamps[-1:]]))
        return bool(gaps.max() < _MAX_GAP * np.median(np.diff(stamps)))

    def turned(self, stamps: np.ndarray, R_world_sensor: Rotation) -> "Turned":
        """The rotation by the rates less their constant bias, from (n,) rotations at stamps [s]; it covers the stamps
        and one interval before and after."""
        spans = np.diff(stamps)
        first, last = np.searchsorted(self.times, (stamps[0] - spans[0], stamps[-1] + spans[-1]))
        times, rates = self.times[first:last], self.rates[first:last]
        steps, bias = R_world_sensor[:-1].inv() * R_world_sensor[1:], np.zeros(3)
        for _ in range(_ROUNDS):
            R = Turned.by(times, rates - bias).at(stamps)
            bias = bias - ((R[:-1].inv() * R[1:]).inv() * steps).as_rotvec().sum(axis=0) / spans.sum()
        return Turned.by(times, rates - bias)


@dataclass(frozen=True, slots=True)
class Turned:
    """Rotation of a sensor since the first of m samples; the rate is linear between them, and constant beyond."""

    times: np.ndarray  # (m,) of the samples [s]
    rates: np.ndarray  # (m, 3) [rad/s]
    quaternions: np.ndarray  # (m, 4) of R_first_sample, x, y, z, w

    @property
    def wander(self) -> float:
        """Density of the angles' random walk [rad^2/s]: white noise of the samples, by their second differences."""
        if len(self.times) < _MIN_SAMPLES:
            return 0.0
        return float((np.diff(self.rates, 2, axis=0) ** 2).mean() / 6 * np.median(np.diff(self.times)))

    @classmethod
    def by(cls, times: np.ndarray, rates: np.ndarray) -> "Turned":
        """The integral of (m, 3) rates [rad/s] at (m,) times [s]."""
        steps = np.diff(times)[:, None] * (rates[1:] + rates[:-1]) / 2
        turns, reach = Rotation.from_rotvec(np.concatenate([np.zeros((1, 3)), steps])).as_quat(), 1
        while reach < len(turns):  # products of 2, 4, 8, ... steps
            turns[reach:] = (Rotation.from_quat(turns[:-reach]) * Rotation.from_quat(turns[reach:])).as_quat()
            reach *= 2
        return cls(times, rates, turns)

    def at(self, stamps: np.ndarray) -> Rotation:
        """(n,) R_first_stamp at stamps [s]."""
        k = np.clip(np.searchsorted(self.times, stamps, side="right") - 1, 0, len(self.times) - 1)
        then = np.column_stack([np.interp(stamps, self.times, rates) for rates in self.rates.T])
        turn = (stamps - self.times[k])[:, None] * (self.rates[k] + then) / 2
        return Rotation.from_quat(self.quaternions[k]) * Rotation.from_rotvec(turn)
