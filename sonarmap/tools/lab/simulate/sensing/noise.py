"""What a sonar does to the truth: speckle, range noise, ghosts, wild and lost echoes; from echoes to a scan."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict
from scipy.ndimage import gaussian_filter

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes, Sensor

NARROWEST, WIDEST = 0.05, 8.0  # of a lobe [beams]; in a narrower one no neighbor is heard


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the ranges (paper Sect. 3, "Gaussian noise along virtual beams") and of the echoes' strengths."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    sigma2: float = 0.0  # variance of range at the sensor's maximum range [m^2]; sigma2 r / max_range at range r
    outliers: float = 0.0  # share of the echoes whose range is instead uniform between the sensor's minimum and maximum
    dropouts: float = 0.0  # share of the echoes that are lost
    # share of the beams that report their second surface, seen in the first as in a mirror, where there is one: the
    # multipath of tools.lab.simulate.sensing.ghosts
    ghosts: float = 0.0
    # share of an echo's strength that fluctuates as speckle does, 0..1. At 1 the amplitude is Rayleigh distributed and
    # the strength, an intensity, exponentially; its mean stays (J. W. Goodman, Statistical Properties of Laser Speckle
    # Patterns, 1975, doi 10.1007/978-3-662-43205-1_2).
    speckle: float = 0.0
    # standard deviation of a beam's main lobe, in beams. Above 0 echoes fade by patches and every beam reports the
    # strongest echo of its lobe, as tools.lab.simulate.sensing.noise has it.
    lobe: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma2) and self.sigma2 >= 0):
            raise InputError(f"noise: sigma2 is {self.sigma2}; wanted a variance >= 0 in m^2")
        for name in ("outliers", "dropouts", "ghosts"):
            share = getattr(self, name)
            if not 0 <= share < 1:
                raise InputError(f"noise: {name} is {share}; wanted a share of the echoes, 0 <= share < 1")
        if not 0 <= self.speckle <= 1:
            raise InputError(f"noise: speckle is {self.speckle}; wanted a share of the strength, 0 <= share <= 1")
        if self.lobe != 0 and not NARROWEST <= self.lobe <= WIDEST:
            raise InputError(f"noise: lobe is {self.lobe}; wanted 0, or a width of {NARROWEST:g} to {WIDEST:g} beams")


def disturb(
    echoes: Echoes, sensor: Sensor, noise: Noise, rng: np.random.Generator, ghosts: Echoes | None = None
) -> Echoes:
    """Echoes with noise; range inf and strength 0 where one was too weak, was lost or left the limits.

    Every beam draws the same numbers whatever it meets and whatever the settings, so that two scans with one seed
    differ only where their scene or their settings do. `ghosts` are what the beams would see in their first surface
    (`simulate.sensing.ghosts.reflect`). Raises InputError: noise with ghosts, and none given.
    """
    if ghosts is None and noise.ghosts > 0:
        raise InputError(f"noise: ghosts is {noise.ghosts}, and no ghosts were given; wanted those of reflect()")
    shape = echoes.ranges.shape
    gauss = rng.standard_normal(shape)
    wild = rng.random(shape)
    wild_range = rng.uniform(sensor.min_range, sensor.max_range, shape)
    lost = rng.random(shape)
    mirrored = rng.random(shape)
    speckle = rng.standard_exponential(shape)
    if ghosts is not None:
        is_ghost = (mirrored < noise.ghosts) & np.isfinite(ghosts.ranges)
        echoes = Echoes(
            np.where(is_ghost, ghosts.ranges, echoes.ranges), np.where(is_ghost, ghosts.strengths, echoes.strengths)
        )
    if noise.lobe > 0:
        echoes = fade(echoes, rng)
    strengths = echoes.strengths * (1 - noise.speckle + noise.speckle * speckle)
    seen = np.isfinite(echoes.ranges) & (strengths >= sensor.threshold)
    true = np.where(seen, echoes.ranges, 0.0)
    measured = true + gauss * np.sqrt(noise.sigma2 * true / sensor.max_range)
    measured = np.where(wild < noise.outliers, wild_range, measured)
    if sensor.resolution > 0:
        measured = np.rint(measured / sensor.resolution) * sensor.resolution
    kept = seen & (lost >= noise.dropouts) & (measured >= sensor.min_range) & (measured <= sensor.max_range)
    noisy = Echoes(np.where(kept, measured, np.inf), np.where(kept, strengths, 0.0))
    return pick_strongest(noisy, noise.lobe) if noise.lobe > 0 else noisy


def scan_of(
    echoes: Echoes, sensor: Sensor, *, stamp: float = 0.0, name: str = "scan", times: np.ndarray | None = None
) -> Scan:
    """The scan of measured echoes: points in the sensor frame, without the empty beams; `times` are those of the beams,
    (rows, columns) [s] after the stamp, None: all at the stamp. Raises InputError: no beam brings an echo back."""
    kept = np.isfinite(echoes.ranges)
    if not kept.any():
        raise InputError(
            f"{name}: the simulated sensor sees nothing from its pose; place it within "
            f"{sensor.max_range:g} m of a surface and turn it there, or lower its threshold of {sensor.threshold:g}"
        )
    points = sensor.directions()[kept] * echoes.ranges[kept][:, None]
    return Scan(
        points=points.astype(np.float32),
        strength=echoes.strengths[kept].astype(np.float32),
        stamp=stamp,
        name=name,
        times=None if times is None else times[kept].astype(np.float32),
    )


FADING, FADED = 4.0, 3.0  # width of what fades together [beams], standard deviation [dB]


def fade(echoes: Echoes, rng: np.random.Generator) -> Echoes:
    """Echoes stronger and weaker by patches, as water and surface have it."""
    fading = gaussian_filter(rng.standard_normal(echoes.ranges.shape), FADING, mode="wrap")
    return Echoes(echoes.ranges, echoes.strengths * 10 ** (FADED / 10 * fading / fading.std()))


def pick_strongest(echoes: Echoes, lobe: float) -> Echoes:
    """For every beam of (rows, columns) range and strength of the strongest echo of its lobe, weighted by the lobe,
    whose standard deviation is in beams; it is taken over twice as many to either side."""
    reach = int(np.ceil(2 * lobe))
    padded = Echoes(np.pad(echoes.ranges, reach, constant_values=np.inf), np.pad(echoes.strengths, reach))
    rows, columns = echoes.ranges.shape
    best = Echoes(np.full((rows, columns), np.inf), np.zeros((rows, columns)))
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            window = (slice(reach + i, reach + i + rows), slice(reach + j, reach + j + columns))
            seen = padded.strengths[window] * np.exp(-0.5 * (i**2 + j**2) / lobe**2)
            stronger = seen > best.strengths
            ranges = np.where(stronger, padded.ranges[window], best.ranges)
            best = Echoes(ranges, np.where(stronger, seen, best.strengths))
    return best
