"""A scene as a vehicle under water meets it: how deep it is, where the vehicle may go, where the scene ends."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.simulate.kinds.sweep import Fan
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, Sensor

DOWN = np.array((0.0, 0.0, -1.0))
SOUNDED = 21  # places along either side of the scene, to know its usual depth
CLEARANCE = 1 / 120  # of the maximum range: nothing nearer to the sonar
EDGE_MOST = 0.01  # share of the beams that may look over the scene's edge


@dataclass(frozen=True)
class Water:
    """The water of a scene, which may be bounded from above by the places of its sensors."""

    scene: Scene

    @cached_property
    def sensor(self) -> Sensor:
        """The sensor that suits the scene's size."""
        return SENSORS[self.scene.kind.sensor]

    @property
    def scale(self) -> float:
        """Lengths chosen for scenes of 256 m are multiplied by it."""
        return self.scene.kind.scale

    @cached_property
    def edge(self) -> np.ndarray:
        """(2,) half sides along x and y [m]."""
        return np.array(self.scene.kind.size) / 2

    @property
    def top(self) -> float:
        """Height of the highest place of a sensor [m]: the surface, or far below it in a deep scene."""
        return min(0.0, self.scene.kind.highest[2])

    @cached_property
    def bed(self) -> float:
        """The usual height of the ground, the median over the scene [m]."""
        axes = [np.linspace(-0.95, 0.95, SOUNDED) * half for half in self.edge]
        return float(np.median(self.ground(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2))))

    def place(self, rng: np.random.Generator) -> np.ndarray:
        """(2,) a place from where there is something to see, where the scene's sensors may be [m]."""
        return rng.uniform(self.scene.kind.lowest[:2], self.scene.kind.highest[:2])

    def height(self, place: np.ndarray, above: float, rng: np.random.Generator) -> float:
        """A height at a place (2,) [m]: anywhere between the scene's sensors, else `above` the ground, under water."""
        lowest, highest = self.scene.kind.lowest[2], self.scene.kind.highest[2]
        if np.isfinite(lowest) and np.isfinite(highest):
            return float(rng.uniform(lowest, highest))
        ground = float(self.ground(place[None])[0])
        return min(ground + above, self.top - 0.1 * (self.top - ground))

    def ground(self, places: np.ndarray) -> np.ndarray:
        """Height (N,) of what lies below `top` at places (N, 2) [m]; the usual depth where nothing does."""
        starts = np.column_stack([places, np.full(len(places), self.top - 1e-3)])
        drop, _ = self.scene.intersect(starts, np.broadcast_to(DOWN, starts.shape))
        heights = starts[:, 2] - drop
        known = np.isfinite(heights)
        return np.where(known, heights, np.median(heights[known]) if known.any() else self.scene.mesh.vertices[0, 2])

    def is_free(self, places: np.ndarray) -> bool:
        """Whether a vehicle may be at all places (N, 3) [m]: under water, within the scene, in no solid."""
        inside = (np.abs(places[:, :2]) < self.edge).all() and (places[:, 2] < 0).all()
        return bool(inside and not self.scene.is_solid(places).any())

    def is_way_free(self, places: np.ndarray) -> bool:
        """Whether nothing stands between each of the places (N, 3) [m] and the next."""
        steps = np.diff(places, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        moved = lengths > 0
        ranges, _ = self.scene.intersect(places[:-1][moved], steps[moved] / lengths[moved, None])
        return bool((ranges > lengths[moved]).all())

    def is_clear(self, ranges: np.ndarray, least: float) -> bool:
        """Whether nothing is too near and a share `least` of the beams meets something."""
        return bool(np.isfinite(ranges).mean() >= least and ranges.min() >= CLEARANCE * self.sensor.max_range)

    def ends(self, fan: Fan, T_world_ping: RigidTransform, ranges: np.ndarray) -> bool:
        """Whether more than a few middle rays, of `ranges` (K, J) [m], inf without an echo, miss ground that would go
        on beyond the scene's edge. The edge would be in both scans of a pair, as plain as a wall: no sea has one."""
        rays = T_world_ping.rotation.as_matrix()[:, None] @ fan.rays[:, len(fan.gains) // 2, :, None]
        slope = -rays[..., 2, 0]
        start = T_world_ping.translation[:, None, :]
        height = np.maximum(start[..., 2] - self.bed, 0.0)
        way = np.divide(height, slope, out=np.full(slope.shape, np.inf), where=slope > 0)
        near = way <= fan.sensor.max_range
        way = np.where(near, way, 0.0)
        heard = slope**2 * 10 ** (-2 * fan.sensor.absorption * way / 10) >= fan.sensor.threshold
        outside = (np.abs(start[..., :2] + way[..., None] * rays[..., :2, 0]) > self.edge).any(axis=-1)
        return bool((np.isinf(ranges) & near & heard & outside).mean() > EDGE_MOST)
