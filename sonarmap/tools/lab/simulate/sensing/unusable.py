"""Scans that show nothing of the scene, as every real survey has some: nearly empty ones, and nothing but noise.

A sensor that hangs and repeats its last scan is a third kind, and not among these: its scans look sound.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.sensing.navigation import entropy_of
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor

Fault = Literal["empty", "noise"]

STREAM = 37  # of the seed: what is drawn here leaves the other scans what they are
STRAY_ECHOES = (3, 12)  # of a nearly empty scan, least and most
NOISY_BEAMS = (0.05, 0.3)  # share of the beams that bring noise back, least and most
WEAK = 0.002  # strength about which stray echoes lie, where the sensor's threshold is not above it


@dataclass(frozen=True, slots=True)
class UnusableScans:
    """The unusable scans of a survey."""

    faults: Mapping[int, Fault]  # the kind of each, by its number
    seed: int  # of the survey; with `dive` it decides what the unusable scans hold
    dive: int = 1  # of the survey

    def scan(self, sensor: Sensor, number: int, stamp: float, name: str) -> Scan:
        """The unusable scan `number`: echoes that no surface gave, spread evenly over the beams and the ranges."""
        rng = np.random.default_rng(_stream(self.seed, self.dive, number))
        beams = sensor.rows * sensor.columns
        low, high = STRAY_ECHOES if self.faults[number] == "empty" else [round(share * beams) for share in NOISY_BEAMS]
        chosen = rng.choice(beams, min(int(rng.integers(low, high + 1)), beams), replace=False)
        ranges = rng.uniform(sensor.min_range, sensor.max_range, len(chosen))
        strength = max(sensor.threshold, WEAK) * (1 + rng.standard_exponential(len(chosen)))
        points = sensor.directions().reshape(-1, 3)[chosen] * ranges[:, None]
        return Scan(points.astype(np.float32), strength.astype(np.float32), stamp=stamp, name=name)


def choose_unusable(share: float, count: int, seed: int, dive: int = 1) -> UnusableScans:
    """Choose round(share * count) of `count` scans, never the first; a larger share keeps those of a smaller one.
    Raises InputError: not a share, or one that leaves no two usable scans."""
    if not 0 <= share < 1:
        raise InputError(f"unusable is {share}; wanted a share of the scans, 0 <= share < 1")
    number = round(share * count)
    if number > max(count - 2, 0):
        raise InputError(f"unusable is {share}: {number} of {count} scans, which leaves no two; wanted a smaller share")
    rng = np.random.default_rng(_stream(seed, dive))
    chosen = 1 + np.argsort(rng.random(max(count - 1, 0)), kind="stable")[:number]
    kinds = get_args(Fault)
    return UnusableScans({int(k): kinds[place % len(kinds)] for place, k in enumerate(chosen)}, seed, dive)


def _stream(seed: int, dive: int, *key: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(entropy_of(seed, STREAM, dive=dive), spawn_key=key)
