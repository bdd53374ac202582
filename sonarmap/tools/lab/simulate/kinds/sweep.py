"""Sweeps of a narrow fan on a moving vehicle: true and assumed poses of the pings, their echoes, and random motions of
the vehicle and its errors."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, Echoes, Sensor


@dataclass(frozen=True, slots=True)
class Fan:
    """The beams of one ping, each a bundle of rays."""

    sensor: Sensor  # its ranges, absorption and threshold
    beams: np.ndarray  # (J, 3) float64 unit vectors, sensor frame: where an echo of each beam is placed
    # (J, L, 3) float64 unit vectors, sensor frame: where each beam truly looks; the middle one is the beam's
    rays: np.ndarray
    gains: np.ndarray  # (L,) float64, 0..1: strength of an echo along each ray against the middle one's, there and back

    def thinned(self, step: int) -> "Fan":
        """The fan with every `step`-th beam, beginning with beam `step // 2`, and only their middle rays."""
        chosen, middle = slice(step // 2, None, step), len(self.gains) // 2
        return Fan(
            self.sensor, self.beams[chosen], self.rays[chosen, middle : middle + 1], self.gains[middle : middle + 1]
        )


@dataclass(frozen=True, slots=True)
class Sweep:
    """True and assumed poses of a scan's pings."""

    T_world_frame: RigidTransform  # of the scan's frame
    T_frame_ping: RigidTransform  # (K,) poses: where the sensor truly was at each ping
    T_frame_believed: RigidTransform  # (K,) poses: where the vehicle believed it was; the points are placed by these
    # (K,) times of the pings [s] after the stamp, if points are placed as if the vehicle stood still; None if they are
    # placed by its navigation
    times: np.ndarray | None = None

    @property
    def T_world_ping(self) -> RigidTransform:
        """(K,) true poses of the pings."""
        return self.T_world_frame * self.T_frame_ping

    def thinned(self, step: int) -> "Sweep":
        """The sweep with every `step`-th ping, and the last."""
        chosen = np.unique(np.append(np.arange(0, len(self.T_frame_ping), step), len(self.T_frame_ping) - 1))
        times = None if self.times is None else self.times[chosen]
        return Sweep(self.T_world_frame, self.T_frame_ping[chosen], self.T_frame_believed[chosen], times)


@dataclass(frozen=True, slots=True)
class Returns:
    """One echo per beam."""

    ranges: np.ndarray  # (K, J) float64 [m]; inf without an echo
    strengths: np.ndarray  # (K, J) float64, linear; 0 without an echo
    rays: np.ndarray  # (K, J) int: index of the ray of the beam along which it truly came


def meet(scene: Scene, fan: Fan, T_world_ping: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
    """Echoes of every ray: (K, J, L) ranges [m], inf without an echo, and strengths, linear.

    The strength is Lambert's law, absorption and the beam pattern, as in `simulate.sensing.sensors`. Surfaces above the
    water, z = 0, give no echo.
    """
    directions = np.einsum("kab,jlb->kjla", T_world_ping.rotation.as_matrix(), fan.rays)
    origins = np.broadcast_to(T_world_ping.translation[:, None, None, :], directions.shape)
    ranges, sines = scene.intersect(origins.reshape(-1, 3), directions.reshape(-1, 3))
    ranges, sines = ranges.reshape(directions.shape[:3]), sines.reshape(directions.shape[:3])
    seen = (ranges >= fan.sensor.min_range) & (ranges <= fan.sensor.max_range)
    distance = np.where(seen, ranges, 0.0)
    seen &= origins[..., 2] + distance * directions[..., 2] <= 0.0
    strengths = np.where(seen, sines**2 * 10 ** (-2 * fan.sensor.absorption * distance / 10) * fan.gains, 0.0)
    return np.where(seen, ranges, np.inf), strengths


def pick(fan: Fan, ranges: np.ndarray, strengths: np.ndarray, cell: float = 0.0, share: float = 1.0) -> Returns:
    """Pick one echo per beam: the first whose energy, summed over ranges within `cell`, is a `share` of the largest.

    A wall that many rays meet at one range is thus stronger than ground that each meets at another. Echoes below the
    sensor's threshold are dropped. Ranges and strengths are (K, J, L), as from `meet`; `cell` is the length of the
    sonar's pulse in range [m]; with a `share` below 1 an earlier, weaker echo is picked.
    """
    energy = strengths
    if cell > 0:
        finite = np.where(np.isfinite(ranges), ranges, 0.0)
        together = np.abs(finite[..., :, None] - finite[..., None, :]) <= cell
        energy = np.where(strengths > 0, np.einsum("kjlm,kjm->kjl", together, strengths), 0.0)
    passed = (energy >= share * energy.max(axis=-1, keepdims=True)) & (strengths >= fan.sensor.threshold)
    # the strongest of the passing rays within a cell of the first
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
    """True points (N, 3) float64 [m, frame of the scan] of the echoes, free of noise and distortion."""
    seen = np.isfinite(returns.ranges)
    ping, beam = np.nonzero(seen)
    directions = fan.rays[beam, returns.rays[seen]]
    return sweep.T_frame_ping[ping].apply(directions * returns.ranges[seen][:, None])


def write_scan(fan: Fan, sweep: Sweep, returns: Returns, noise: Noise, rng: np.random.Generator, name: str) -> Scan:
    """Make the scan with noise, its points placed along the middle of the beams from the assumed poses.

    Its viewpoints are the assumed positions of the sensor, its times those of the pings. Raises InputError: no beam
    has an echo.
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


SLOW = 1 / 30  # share of a sweep over which a walk's steps are correlated


def walk(count: int, sigmas: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """A random walk (count, len(sigmas)) with smooth steps that is 0 in the middle and has these standard deviations at
    either end: drift that grows with the square root of time."""
    steps = gaussian_filter1d(rng.standard_normal((count, len(sigmas))), max(SLOW * count, 1e-3), axis=0)
    path = np.cumsum(steps, axis=0) * np.sqrt(2 / count)
    return (path - path[count // 2]) * sigmas


def wobble(count: int, sigmas: tuple[float, ...], width: float, rng: np.random.Generator) -> np.ndarray:
    """A stationary random motion (count, len(sigmas)) with these standard deviations, correlated over about `width`
    steps."""
    smooth = gaussian_filter1d(rng.standard_normal((count, len(sigmas))), width, axis=0, mode="wrap")
    # standard deviation of the smoothed white noise, from the energy of the kernel
    kernel = np.zeros(count)
    kernel[count // 2] = 1.0
    deviation = np.sqrt((gaussian_filter1d(kernel, width, mode="wrap") ** 2).sum())
    return smooth / deviation * sigmas


DOWN = np.array((0.0, 0.0, -1.0))
SOUNDED = 21  # positions along x and y at which the scene's median height is measured
CLEARANCE = 1 / 120  # least range of a surface, in shares of the maximum range
EDGE_MOST = 0.01  # largest share of the beams that look over the scene's edge


@dataclass(frozen=True)
class Water:
    """The water of a scene, up to the highest position of its sensors."""

    scene: Scene

    @cached_property
    def sensor(self) -> Sensor:
        """The sensor that suits the scene's size."""
        return SENSORS[self.scene.kind.sensor]

    @property
    def scale(self) -> float:
        """Factor of lengths chosen for scenes of 256 m."""
        return self.scene.kind.scale

    @cached_property
    def edge(self) -> np.ndarray:
        """Half extents (2,) of the scene along x and y [m]."""
        return np.array(self.scene.kind.size) / 2

    @property
    def top(self) -> float:
        """Greatest height of a sensor [m]: the water's surface, or far below it in a deep scene."""
        return min(0.0, self.scene.kind.highest[2])

    @cached_property
    def bed(self) -> float:
        """Median height of the ground over the scene [m]."""
        axes = [np.linspace(-0.95, 0.95, SOUNDED) * half for half in self.edge]
        return float(np.median(self.ground(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2))))

    def place(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a position (2,) [m] within the scene's bounds of sensors."""
        return rng.uniform(self.scene.kind.lowest[:2], self.scene.kind.highest[:2])

    def height(self, place: np.ndarray, above: float, rng: np.random.Generator) -> float:
        """Draw a height at a place (2,) [m]: within the scene's bounds of sensors, if any; else `above` the ground."""
        lowest, highest = self.scene.kind.lowest[2], self.scene.kind.highest[2]
        if np.isfinite(lowest) and np.isfinite(highest):
            return float(rng.uniform(lowest, highest))
        ground = float(self.ground(place[None])[0])
        return min(ground + above, self.top - 0.1 * (self.top - ground))

    def ground(self, places: np.ndarray) -> np.ndarray:
        """Heights (N,) of the highest surface below `top` at places (N, 2) [m]; their median where there is none."""
        starts = np.column_stack([places, np.full(len(places), self.top - 1e-3)])
        drop, _ = self.scene.intersect(starts, np.broadcast_to(DOWN, starts.shape))
        heights = starts[:, 2] - drop
        met = np.isfinite(heights)
        return np.where(met, heights, np.median(heights[met]) if met.any() else self.scene.mesh.vertices[0, 2])

    def is_free(self, places: np.ndarray) -> bool:
        """Whether a vehicle may be at all places (N, 3) [m]: under water, within the scene, in no solid."""
        inside = (np.abs(places[:, :2]) < self.edge).all() and (places[:, 2] < 0).all()
        return bool(inside and not self.scene.is_solid(places).any())

    def is_way_free(self, places: np.ndarray) -> bool:
        """Whether the straight path through the places (N, 3) [m] meets no surface."""
        steps = np.diff(places, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        moved = lengths > 0
        ranges, _ = self.scene.intersect(places[:-1][moved], steps[moved] / lengths[moved, None])
        return bool((ranges > lengths[moved]).all())

    def is_clear(self, ranges: np.ndarray, least: float) -> bool:
        """Whether no surface is too close and at least a share `least` of the beams has an echo."""
        return bool(np.isfinite(ranges).mean() >= least and ranges.min() >= CLEARANCE * self.sensor.max_range)

    def ends(self, fan: Fan, T_world_ping: RigidTransform, ranges: np.ndarray) -> bool:
        """Whether too many middle rays, with `ranges` (K, J) [m], inf without an echo, miss ground because it ends at
        the scene's edge. Both scans of a pair would show that edge as plainly as a wall, and no sea has one."""
        rays = T_world_ping.rotation.as_matrix()[:, None] @ fan.rays[:, len(fan.gains) // 2, :, None]
        slope = -rays[..., 2, 0]
        start = T_world_ping.translation[:, None, :]
        height = np.maximum(start[..., 2] - self.bed, 0.0)
        distance = np.divide(height, slope, out=np.full(slope.shape, np.inf), where=slope > 0)
        near = distance <= fan.sensor.max_range
        distance = np.where(near, distance, 0.0)
        detected = slope**2 * 10 ** (-2 * fan.sensor.absorption * distance / 10) >= fan.sensor.threshold
        outside = (np.abs(start[..., :2] + distance[..., None] * rays[..., :2, 0]) > self.edge).any(axis=-1)
        return bool((np.isinf(ranges) & near & detected & outside).mean() > EDGE_MOST)
