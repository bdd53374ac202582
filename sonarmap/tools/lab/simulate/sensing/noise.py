"""Noise of a sonar: speckle, range noise, ghosts, outliers and dropouts; conversion of echoes to a scan."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes, Sensor, beams, echoes_of

NARROWEST, WIDEST = 0.05, 8.0  # width of a lobe [beams]; a narrower one does not reach the next beam


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the ranges (paper Sect. 3, "Gaussian noise along virtual beams") and of the echoes' strengths."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    sigma2: float = 0.0  # variance of range at the sensor's maximum range [m^2]; sigma2 r / max_range at range r
    outliers: float = 0.0  # share of the echoes whose range is instead uniform between the sensor's minimum and maximum
    dropouts: float = 0.0  # share of the echoes that are lost
    # share of the beams that report the second surface, if there is one, mirrored by the first: see `reflect`
    ghosts: float = 0.0
    # share of an echo's strength that fluctuates as speckle does, 0..1. At 1 the amplitude is Rayleigh distributed and
    # the strength, an intensity, exponentially; its mean stays (J. W. Goodman, Statistical Properties of Laser Speckle
    # Patterns, 1975, doi 10.1007/978-3-662-43205-1_2).
    speckle: float = 0.0
    # standard deviation of a beam's main lobe, in beams. Above 0, echoes fade in patches and every beam reports the
    # strongest echo of its lobe.
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
    """Add noise to echoes; range inf and strength 0 where an echo is too weak, lost, or out of the sensor's ranges.

    Every beam draws the same random numbers for any scene and settings, so that two scans with the same seed differ
    only where their scene or settings do. `ghosts` are the echoes mirrored by the first surface (`reflect`). Raises
    InputError: the noise has ghosts, and `ghosts` is None.
    """
    if ghosts is None and noise.ghosts > 0:
        raise InputError(f"noise: ghosts is {noise.ghosts}, and no ghosts were given; wanted those of reflect()")
    shape = echoes.ranges.shape
    gauss = rng.standard_normal(shape)
    outlier = rng.random(shape)
    outlier_range = rng.uniform(sensor.min_range, sensor.max_range, shape)
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
    measured = np.where(outlier < noise.outliers, outlier_range, measured)
    if sensor.resolution > 0:
        measured = np.rint(measured / sensor.resolution) * sensor.resolution
    kept = seen & (lost >= noise.dropouts) & (measured >= sensor.min_range) & (measured <= sensor.max_range)
    noisy = Echoes(np.where(kept, measured, np.inf), np.where(kept, strengths, 0.0))
    return pick_strongest(noisy, noise.lobe) if noise.lobe > 0 else noisy


def scan_of(
    echoes: Echoes, sensor: Sensor, *, stamp: float = 0.0, name: str = "scan", times: np.ndarray | None = None
) -> Scan:
    """Make a scan of echoes: points in the sensor frame of the beams with an echo. `times` are those of the beams,
    (rows, columns) [s] after the stamp; None: all at the stamp. Raises InputError: no beam has an echo."""
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


FADING, FADED = 4.0, 3.0  # correlation width [beams] and standard deviation [dB] of fading


def fade(echoes: Echoes, rng: np.random.Generator) -> Echoes:
    """Make echoes stronger and weaker in patches, as water and surfaces do."""
    fading = gaussian_filter(rng.standard_normal(echoes.ranges.shape), FADING, mode="wrap")
    return Echoes(echoes.ranges, echoes.strengths * 10 ** (FADED / 10 * fading / fading.std()))


def pick_strongest(echoes: Echoes, lobe: float) -> Echoes:
    """Replace the echo of every beam by the strongest one of its lobe, a Gaussian of standard deviation `lobe` [beams]
    that is cut off at twice that. The strength is weighted by the lobe."""
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


MIRROR_LOSS_DB = 6.0  # of an echo reflected by a mirror there and back: 3 dB each, as from a rough bed
SKIN = 1e-3  # offset of a mirrored ray's start from the mirror, which it would hit again [m]


def reflect(scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform) -> Echoes:
    """Echoes of the second surface along every beam, which the first surface mirrors.

    A beam is mirrored by the first surface, meets a second one, and its echo comes back along the same path. The sonar
    reports the length of the whole path in the direction of the beam: the ghost lies behind the first surface, at the
    mirror image of the second one.

    For a sensor under water the water's surface z = 0 is a mirror, too, and surfaces above it give no ghost; for a
    sensor above it there is no water. The strength is Lambert's law at the second surface, less 6 dB. The ranges are
    the lengths of the whole paths [m], inf if there is no second surface within the sensor's ranges.
    """
    return reflect_beams(scene, sensor, *beams(sensor, T_world_sensor))


def reflect_beams(scene: Scene, sensor: Sensor, origins: np.ndarray, directions: np.ndarray) -> Echoes:
    """As `reflect`, with one origin per beam: origins [m] and unit vectors, both (rows * columns, 3), world.

    If the first origin is under water, all of them are taken to be.
    """
    distances, normals = scene.intersect_with_normals(origins, directions)
    under_water = bool(origins[0, 2] < 0)
    if under_water:
        distances, normals = _meet_water(origins, directions, distances, normals)
    met = np.flatnonzero(np.isfinite(distances) & (distances > 0))
    mirrors = origins[met] + distances[met, None] * directions[met]
    onward, sines = _second_surface(scene, mirrors, directions[met], normals[met], under_water)
    ranges, sine_grazing = np.full(len(directions), np.inf), np.zeros(len(directions))
    ranges[met] = distances[met] + onward
    sine_grazing[met] = sines
    echoes = echoes_of(sensor, ranges, sine_grazing)
    return Echoes(echoes.ranges, echoes.strengths * 10 ** (-MIRROR_LOSS_DB / 10))


def measure(
    scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform, echoes: Echoes, noise: Noise, rng: np.random.Generator
) -> Echoes:
    """Add noise to the `echoes` from a pose, with ghosts if the noise has them."""
    ghosts = reflect(scene, sensor, T_world_sensor) if noise.ghosts > 0 else None
    return disturb(echoes, sensor, noise, rng, ghosts)


def _second_surface(
    scene: Scene, mirrors: np.ndarray, directions: np.ndarray, normals: np.ndarray, under_water: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (M,) [m] from the mirrors (M, 3) to the second surface, inf without one, and its grazing sines."""
    closing = np.einsum("ij,ij->i", directions, normals)[:, None]
    mirrored = directions - 2 * closing * normals
    starts = mirrors - SKIN * np.sign(closing) * normals
    shifted, second = scene.intersect_with_normals(starts, mirrored)
    seen = np.isfinite(shifted)
    ends = starts + np.where(seen, shifted, 0.0)[:, None] * mirrored
    # distance to the second surface's plane from the mirror itself, not from the offset start of the ray
    slope = np.einsum("ij,ij->i", second, mirrored)
    height = np.einsum("ij,ij->i", second, ends - mirrors)
    onward = np.divide(height, slope, out=np.full(len(slope), np.inf), where=seen & (slope != 0))
    if under_water:
        onward[ends[:, 2] > 0] = np.inf
    return onward, np.minimum(np.abs(slope), 1.0)


def _meet_water(
    origins: np.ndarray, directions: np.ndarray, distances: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances and normals, with those of the water's surface where a beam from below meets it first."""
    rising = directions[:, 2] > 0
    to_water = np.full(len(directions), np.inf)
    to_water[rising] = -origins[rising, 2] / directions[rising, 2]
    first = to_water < distances
    return np.where(first, to_water, distances), np.where(first[:, None], (0.0, 0.0, 1.0), normals)
