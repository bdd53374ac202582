"""Random pairs of scans with a wanted overlap, for tests and for developing a registration."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from spectral.scan import Scan
from tools.simulate.noise import Noise, measure
from tools.simulate.overlap import overlap
from tools.simulate.scenes import Scene, build_scene
from tools.simulate.sensors import ECLIPSE, Sensor, cast

TRIES = 400
CLEARANCE = 6.0  # least range of any echo from a random pose [m]


def random_pair(
    seed: int,
    overlaps: tuple[float, float] = (0.5, 0.9),
    noise: Noise = Noise(),  # noqa: B008 (frozen)
    scene: str = "clutter",
    sensor: Sensor = ECLIPSE,
    max_tilt: float = np.deg2rad(10.0),
) -> tuple[Scan, Scan, RigidTransform]:
    """Two scans of one scene from random poses whose noise-free overlap lies within `overlaps`.

    Args:
        seed: of the scene, the poses and the noise.
        overlaps: least and greatest share of the source's points within 2 m of a target's point.
        noise, scene, sensor: what disturbs, a key of SCENES, what to see with.
        max_tilt: largest roll and pitch of either pose [rad].

    Returns:
        target Scan, source Scan, T_target_source, all between sensor frames. Raises InputError where no such
        pair was found within 400 tries.
    """
    world = build_scene(scene, seed)
    pose_seed, target_seed, source_seed = np.random.SeedSequence([seed, 17]).spawn(3)
    rng = np.random.default_rng(pose_seed)
    T_world_target = _clear_pose(world, sensor, max_tilt, rng)
    target = cast(world, sensor, T_world_target)
    seen = measure(target, sensor, Noise(), np.random.default_rng(0)).points
    least, greatest = overlaps
    for _ in range(TRIES):
        T_world_source = _neighbor(T_world_target, sensor, max_tilt, rng)
        source = cast(world, sensor, T_world_source)
        if not _is_clear(source.ranges):
            continue
        points = measure(source, sensor, Noise(), np.random.default_rng(0)).points
        T_target_source = T_world_target.inv() * T_world_source
        if least <= overlap(seen, points, T_target_source) <= greatest:
            return (
                measure(target, sensor, noise, np.random.default_rng(target_seed), stamp=0.0, name="target"),
                measure(source, sensor, noise, np.random.default_rng(source_seed), stamp=1.0, name="source"),
                T_target_source,
            )
    raise InputError(
        f"no pair of poses in {scene} with seed {seed} has an overlap within {least:g} to {greatest:g}; "
        "widen the range or try another seed"
    )


def _clear_pose(world: Scene, sensor: Sensor, max_tilt: float, rng: np.random.Generator) -> RigidTransform:
    """A pose in the inner half of the scene with nothing near and most beams meeting something."""
    for _ in range(TRIES):
        place = rng.uniform((-70, -70, -6), (70, 70, 4))
        pose = RigidTransform.from_components(place, _attitude(rng.uniform(-np.pi, np.pi), max_tilt, rng))
        if _is_clear(cast(world, sensor, pose).ranges):
            return pose
    raise InputError("the scene has no clear place for a sensor; build a less crowded one")


def _neighbor(T_world_target: RigidTransform, sensor: Sensor, max_tilt: float, rng: np.random.Generator):
    """A pose not far from the target's: shifted by up to a third of the range, turned by up to 60 degrees."""
    reach = sensor.max_range / 3
    place = T_world_target.translation + rng.uniform(-1, 1, 3) * (reach, reach, min(reach, 5.0))
    yaw = T_world_target.rotation.as_euler("ZYX")[0] + rng.uniform(-np.pi / 3, np.pi / 3)
    return RigidTransform.from_components(place, _attitude(yaw, max_tilt, rng))


def _attitude(yaw: float, max_tilt: float, rng: np.random.Generator) -> Rotation:
    pitch, roll = rng.uniform(-max_tilt, max_tilt, 2)
    return Rotation.from_euler("ZYX", (yaw, pitch, roll))


def _is_clear(ranges: np.ndarray) -> bool:
    """Whether nothing stands close before the sensor and at least a fourth of the beams meet something."""
    return bool(ranges.min() >= CLEARANCE and np.isfinite(ranges).mean() >= 0.25)
