"""A narrow fan on a vehicle that moves while it measures: where each ping was, where the vehicle believed it was, and
what the fan meets; the random walks and wobbles that move the vehicle and what it believes."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes, Sensor


@dataclass(frozen=True, slots=True)
class Fan:
    """The beams of one ping, each a bundle of rays."""

    sensor: Sensor  # its ranges and its water
    beams: np.ndarray  # (J, 3) float64 unit vectors, sensor frame: where an echo of each beam is placed
    # (J, L, 3) float64 unit vectors, sensor frame: where each beam truly looks; the middle one is the beam's
    rays: np.ndarray
    gains: np.ndarray  # (L,) float64, 0..1: strength of an echo along each ray against the middle one's, there and back

    def thinned(self, step: int) -> "Fan":
        """Every `step`-th beam from the middle of the first `step`, and of each only the middle ray."""
        chosen, middle = slice(step // 2, None, step), len(self.gains) // 2
        return Fan(
            self.sensor, self.beams[chosen], self.rays[chosen, middle : middle + 1], self.gains[middle : middle + 1]
        )


@dataclass(frozen=True, slots=True)
class Sweep:
    """Where a scan's pings were."""

    T_world_frame: RigidTransform  # of the scan's frame
    T_frame_ping: RigidTransform  # (K,) poses: where the sensor truly was at each ping
    T_frame_believed: RigidTransform  # (K,) poses: where the vehicle believed it was; the points are placed by these
    # (K,) of the pings [s] after the stamp, where the vehicle takes itself to stand still in its own frame; None where
    # its points have been brought to the frame by what it knows of its way
    times: np.ndarray | None = None

    @property
    def T_world_ping(self) -> RigidTransform:
        """(K,) poses."""
        return self.T_world_frame * self.T_frame_ping

    def thinned(self, step: int) -> "Sweep":
        """Every `step`-th ping, and the last."""
        chosen = np.unique(np.append(np.arange(0, len(self.T_frame_ping), step), len(self.T_frame_ping) - 1))
        times = None if self.times is None else self.times[chosen]
        return Sweep(self.T_world_frame, self.T_frame_ping[chosen], self.T_frame_believed[chosen], times)


@dataclass(frozen=True, slots=True)
class Returns:
    """One echo a beam."""

    ranges: np.ndarray  # (K, J) float64 [m]; inf without an echo
    strengths: np.ndarray  # (K, J) float64, linear; 0 without an echo
    rays: np.ndarray  # (K, J) int: along which ray of the beam it truly came


def meet(scene: Scene, fan: Fan, T_world_ping: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
    """What every ray meets: (K, J, L) ranges [m], inf without an echo, and strengths, linear.

    The strength is Lambert's law, the losses of the way and the beam's pattern, as `simulate.sensing.sensors` has it.
    A sonar is under water: what stands above the surface z = 0 gives no echo.
    """
    directions = np.einsum("kab,jlb->kjla", T_world_ping.rotation.as_matrix(), fan.rays)
    origins = np.broadcast_to(T_world_ping.translation[:, None, None, :], directions.shape)
    ranges, sines = scene.intersect(origins.reshape(-1, 3), directions.reshape(-1, 3))
    ranges, sines = ranges.reshape(directions.shape[:3]), sines.reshape(directions.shape[:3])
    seen = (ranges >= fan.sensor.min_range) & (ranges <= fan.sensor.max_range)
    way = np.where(seen, ranges, 0.0)
    seen &= origins[..., 2] + way * directions[..., 2] <= 0.0
    strengths = np.where(seen, sines**2 * 10 ** (-2 * fan.sensor.absorption * way / 10) * fan.gains, 0.0)
    return np.where(seen, ranges, np.inf), strengths


def pick(fan: Fan, ranges: np.ndarray, strengths: np.ndarray, cell: float = 0.0, share: float = 1.0) -> Returns:
    """One echo a beam: the first whose energy, summed over ranges within `cell`, is a `share` of the largest.

    A wall that many rays meet at one range is thus stronger than ground that each meets at another. What stays below
    the sensor's threshold gives no echo. Ranges and strengths are (K, J, L), as from `meet`; the cell is the length of
    the sonar's pulse in range [m]; a share below 1 is an earlier echo that passes the detector's threshold.
    """
    energy = strengths
    if cell > 0:
        finite = np.where(np.isfinite(ranges), ranges, 0.0)
        together = np.abs(finite[..., :, None] - finite[..., None, :]) <= cell
        energy = np.where(strengths > 0, np.einsum("kjlm,kjm->kjl", together, strengths), 0.0)
    passed = (energy >= share * energy.max(axis=-1, keepdims=True)) & (strengths >= fan.sensor.threshold)
    # among the rays that pass together with the first, the one that carries most of it
    first = np.where(passed, ranges, np.inf).min(axis=-1, keepdims=True)
    ray = np.where(passed & (ranges <= first + cell), strengths, -1.0).argmax(axis=-1)
    chosen = ray[..., None]
    seen = np.take_along_axis(passed & np.isfinite(ranges), chosen, -1)[..., 0]
    return Returns(
        np.where(seen, np.take_along_axis(ranges, chosen, -1)[..., 0], np.inf),
        np.where(seen, np.take_along_axis(strengths, chosen, -1)[..., 0], 0.0),
        ray,
    )


def true_points(fan: Fan, sweep: Sweep, returns: Returns) -> np.ndarray:
    """(N, 3) float64 [m], frame of the scan: where the echoes truly came from, free of noise and distortion."""
    seen = np.isfinite(returns.ranges)
    ping, beam = np.nonzero(seen)
    directions = fan.rays[beam, returns.rays[seen]]
    return sweep.T_frame_ping[ping].apply(directions * returns.ranges[seen][:, None])


def write_scan(fan: Fan, sweep: Sweep, returns: Returns, noise: Noise, rng: np.random.Generator, name: str) -> Scan:
    """The scan that the vehicle writes: with noise, in the beams' believed directions, from the believed places.

    Its viewpoints are where the sensor was believed to be when it saw each point, its times those of the pings. Raises
    InputError: no beam brings an echo back.
    """
    noisy = disturb(Echoes(returns.ranges, returns.strengths), fan.sensor, noise, rng)
    kept = np.isfinite(noisy.ranges)
    if not kept.any():
        raise InputError(f"{name}: no beam of the sweep brings an echo back; place it nearer to a surface")
    ping, beam = np.nonzero(kept)
    believed = sweep.T_frame_believed[ping]
    return Scan(
        points=believed.apply(fan.beams[beam] * noisy.ranges[kept][:, None]).astype(np.float32),
        strength=noisy.strengths[kept].astype(np.float32),
        stamp=1.0 if name == "source" else 0.0,
        name=name,
        viewpoints=believed.translation.astype(np.float32),
        times=None if sweep.times is None else sweep.times[ping].astype(np.float32),
    )


SLOW = 1 / 30  # of a sweep: a walk's steps are alike over about this share of it


def walk(count: int, sigmas: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """A random walk (count, len(sigmas)) that is 0 in the middle and has these standard deviations at either end, with
    smooth steps: drift that grows with the square root of time."""
    steps = gaussian_filter1d(rng.standard_normal((count, len(sigmas))), max(SLOW * count, 1e-3), axis=0)
    path = np.cumsum(steps, axis=0) * np.sqrt(2 / count)
    return (path - path[count // 2]) * sigmas


def wobble(count: int, sigmas: tuple[float, ...], width: float, rng: np.random.Generator) -> np.ndarray:
    """A stationary random motion, alike over about `width` steps, with these standard deviations. Returns (count,
    len(sigmas)) float64."""
    smooth = gaussian_filter1d(rng.standard_normal((count, len(sigmas))), width, axis=0, mode="wrap")
    # the smoothing kernel's energy: what is left of the variance of white noise
    kernel = np.zeros(count)
    kernel[count // 2] = 1.0
    left = np.sqrt((gaussian_filter1d(kernel, width, mode="wrap") ** 2).sum())
    return smooth / left * sigmas
