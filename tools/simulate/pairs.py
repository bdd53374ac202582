"""Random pairs of scans with a wanted overlap, for tests and for developing a registration."""

import math

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from spectral.scan import Scan
from tools.simulate.catalog import SceneKind
from tools.simulate.noise import Noise, measure
from tools.simulate.overlap import OVERLAP_RADIUS, mutual_overlap
from tools.simulate.scenes import Scene, build_scene
from tools.simulate.sensors import SENSORS, Echoes, Sensor, bare, cast

TRIES = 400
NOISELESS = Noise()
ABOVE = 200.0  # where the search for the ground starts in a scene of 256 m [m]
ASIDE = np.pi / 4  # an inward look is at most this far from the scene's middle [rad]

# In shares of the sensor's maximum range
CLEARANCE = 1 / 20  # nothing nearer before the sensor
HEIGHT = (0.1, 0.25)  # above what stands below the target's place
REACH = (1 / 3, 1 / 3, 1 / 24)  # from the target to the source
SEEN_LEAST = 0.25  # of the beams


def random_pair(
    seed: int,
    overlaps: tuple[float, float] = (0.5, 0.9),
    noise: Noise = NOISELESS,
    scene: str = "clutter",
    sensor: Sensor | None = None,
    max_tilt: float = math.radians(10.0),
) -> tuple[Scan, Scan, RigidTransform]:
    """Two scans of one scene from random poses whose noise-free overlap lies within `overlaps`.

    Args:
        seed: of the scene, the poses and the noise.
        overlaps: least and greatest share of the points within 2 m of the other scan (the smaller of both
            ways); in a smaller scene the radius is smaller by the same factor.
        noise, scene: what disturbs, a key of SCENES.
        sensor: what to see with; the bare fan of the one that suits the scene if left out. The overlap is of all
            echoes, also of those under a sensor's threshold.
        max_tilt: largest roll and pitch of either pose [rad].

    Returns:
        target Scan, source Scan, T_target_source, all between sensor frames.

    Raises:
        InputError: no such pair was found within 400 tries.
    """
    world = build_scene(scene, seed)
    sensor = bare(SENSORS[world.kind.sensor]) if sensor is None else sensor
    pose_seed, target_seed, source_seed = np.random.SeedSequence([seed, 17]).spawn(3)
    rng = np.random.default_rng(pose_seed)
    T_world_target, target = _target(world, sensor, max_tilt, rng)
    T_world_source, source = _source(world, sensor, max_tilt, overlaps, (T_world_target, target), rng)
    return (
        measure(target, sensor, noise, np.random.default_rng(target_seed), stamp=0.0, name="target"),
        measure(source, sensor, noise, np.random.default_rng(source_seed), stamp=1.0, name="source"),
        T_world_target.inv() * T_world_source,
    )


def _target(world: Scene, sensor: Sensor, max_tilt: float, rng: np.random.Generator) -> tuple[RigidTransform, Echoes]:
    """A pose in the inner part of the scene, above what stands there, with nothing near before it."""
    kind = world.kind
    for _ in range(TRIES):
        above = np.array([*rng.uniform(kind.lowest[:2], kind.highest[:2]), min(ABOVE * kind.scale, kind.highest[2])])
        drop, _ = world.intersect(above[None, :], np.array([[0.0, 0.0, -1.0]]))
        place = above - (0, 0, drop[0] - rng.uniform(*HEIGHT) * sensor.max_range)
        place[2] = np.clip(place[2], kind.lowest[2], kind.highest[2])
        pose = RigidTransform.from_components(place, _attitude(_heading(place, kind, rng), max_tilt, rng))
        if not _is_free(world, pose):
            continue
        echoes = cast(world, sensor, pose)
        if _is_clear(echoes, sensor):
            return pose, echoes
    raise InputError(f"{world.name} has no clear place for the sensor {sensor.name}; take another scene or seed")


def _source(
    world: Scene,
    sensor: Sensor,
    max_tilt: float,
    overlaps: tuple[float, float],
    target: tuple[RigidTransform, Echoes],
    rng: np.random.Generator,
) -> tuple[RigidTransform, Echoes]:
    """A pose not far from the target's, turned by up to 60 degrees, whose overlap is as wanted."""
    T_world_target, seen = target
    points = _points(seen, sensor)
    radius = OVERLAP_RADIUS * world.kind.scale
    heading = T_world_target.rotation.as_euler("ZYX")[0]
    for _ in range(TRIES):
        place = T_world_target.translation + sensor.max_range * rng.uniform(-1, 1, 3) * REACH
        yaw = heading + rng.uniform(-np.pi / 3, np.pi / 3)
        pose = RigidTransform.from_components(place, _attitude(yaw, max_tilt, rng))
        if not _is_free(world, pose):
            continue
        echoes = cast(world, sensor, pose)
        if not _is_clear(echoes, sensor):
            continue
        share = mutual_overlap(points, _points(echoes, sensor), T_world_target.inv() * pose, radius)
        if overlaps[0] <= share <= overlaps[1]:
            return pose, echoes
    raise InputError(
        f"no pose in {world.name} has an overlap within {overlaps[0]:g} to {overlaps[1]:g} with the target; "
        "widen the range or take another seed"
    )


def _heading(place: np.ndarray, kind: SceneKind, rng: np.random.Generator) -> float:
    """Anywhere, or about where the scene's middle lies [rad]."""
    heading = rng.uniform(-np.pi, np.pi)
    return np.arctan2(-place[1], -place[0]) + heading * ASIDE / np.pi if kind.inward else heading


def _is_free(world: Scene, pose: RigidTransform) -> bool:
    """Whether the sensor is out of every solid, and, where a scene bounds its water from above, in that water."""
    place, kind = pose.translation, world.kind
    if np.isfinite(kind.highest[2]) and not ((place >= kind.lowest) & (place <= kind.highest)).all():
        return False
    return not world.is_solid(place[None, :])[0]


def _attitude(yaw: float, max_tilt: float, rng: np.random.Generator) -> Rotation:
    pitch, roll = rng.uniform(-max_tilt, max_tilt, 2)
    return Rotation.from_euler("ZYX", (yaw, pitch, roll))


def _points(echoes: Echoes, sensor: Sensor) -> np.ndarray:
    seen = np.isfinite(echoes.ranges)
    return sensor.directions()[seen] * echoes.ranges[seen][:, None]


def _is_clear(echoes: Echoes, sensor: Sensor) -> bool:
    """Whether nothing stands close before the sensor and enough beams meet something."""
    enough = np.isfinite(echoes.ranges).mean() >= SEEN_LEAST
    return bool(enough and echoes.ranges.min() >= CLEARANCE * sensor.max_range)
