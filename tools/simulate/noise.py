"""What a sonar does to the truth: range noise, wild echoes, lost echoes; from echoes to a scan."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict

from kernels.errors import InputError
from spectral.scan import Scan
from tools.simulate.sensors import Echoes, Sensor


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the ranges (paper Sect. 3, "Gaussian noise along virtual beams").

    Attributes:
        sigma2: variance of range at the sensor's maximum range [m^2]; sigma2 r / max_range at range r.
        outliers: share of the echoes whose range is instead uniform between the sensor's minimum and maximum.
        dropouts: share of the echoes that are lost.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    sigma2: float = 0.0
    outliers: float = 0.0
    dropouts: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma2) and self.sigma2 >= 0):
            raise InputError(f"noise: sigma2 is {self.sigma2}; wanted a variance >= 0 in m^2")
        for name, share in (("outliers", self.outliers), ("dropouts", self.dropouts)):
            if not 0 <= share < 1:
                raise InputError(f"noise: {name} is {share}; wanted a share of the echoes, 0 <= share < 1")


def disturb(ranges: np.ndarray, sensor: Sensor, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Ranges (any shape, inf without an echo) with noise; inf where the echo was lost or left the limits.

    Every beam draws the same numbers whatever it meets and whatever the settings, so that two scans with one
    seed differ only where their scene or their settings do.
    """
    gauss = rng.standard_normal(ranges.shape)
    wild = rng.random(ranges.shape)
    wild_range = rng.uniform(sensor.min_range, sensor.max_range, ranges.shape)
    lost = rng.random(ranges.shape)
    seen = np.isfinite(ranges)
    true = np.where(seen, ranges, 0.0)
    measured = true + gauss * np.sqrt(noise.sigma2 * true / sensor.max_range)
    measured = np.where(wild < noise.outliers, wild_range, measured)
    kept = seen & (lost >= noise.dropouts) & (measured >= sensor.min_range) & (measured <= sensor.max_range)
    return np.where(kept, measured, np.inf)


def measure(
    echoes: Echoes,
    sensor: Sensor,
    noise: Noise,
    rng: np.random.Generator,
    *,
    stamp: float = 0.0,
    name: str = "scan",
) -> Scan:
    """The scan that the sensor writes: points in the sensor frame, with noise, without the empty beams."""
    ranges = disturb(echoes.ranges, sensor, noise, rng)
    kept = np.isfinite(ranges)
    if not kept.any():
        raise InputError(
            f"{name}: the simulated sensor sees nothing from its pose; place it within "
            f"{sensor.max_range:g} m of a surface and turn it there"
        )
    points = sensor.directions()[kept] * ranges[kept][:, None]
    return Scan(
        points=points.astype(np.float32),
        strength=echoes.strengths[kept].astype(np.float32),
        stamp=stamp,
        name=name,
    )
