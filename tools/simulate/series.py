"""The paper's Table 1: ten scans S0..S9, ever farther from the reference scan and ever more turned."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from spectral.scan import Scan
from tools.simulate.noise import Noise, measure
from tools.simulate.scenes import build_scene
from tools.simulate.sensors import PAPER, Sensor, cast

TABLE1_COUNT = 10
TABLE1_STEP = (4.0, 8.0, 12.0)  # x, y, z a step [m]; one voxel of the paper's 256^3 grid is 1 m
TABLE1_STEP_DEG = (6.0, 1.0, 2.0)  # yaw, pitch, roll a step

# Where the sensor rig stands in the grid frame [m]: before the structure, above the water, its fan looking
# down. Chosen so that the overlap falls smoothly from 0.9 at S0 to a fifth at S9 (the paper's Fig. 19).
TABLE1_RIG = (-100.0, -30.0, 10.0)
TABLE1_SENSOR: Sensor = replace(PAPER, tilt=np.deg2rad(30.0))


def table1_transform(index: int) -> RigidTransform:
    """Row S`index` of Table 1: p_target = R p_source + t in the grid frame [m].

    R = Rz(yaw) Ry(pitch) Rx(roll). The grid is a cube of 256 m whose center is the origin; z is up.
    The reference scan is the target.
    """
    if not 0 <= index < TABLE1_COUNT:
        raise InputError(f"Table 1 has the scans S0 to S{TABLE1_COUNT - 1}; got index {index}")
    angles = (index + 1) * np.deg2rad(TABLE1_STEP_DEG)
    return RigidTransform.from_components(
        (index + 1) * np.array(TABLE1_STEP), Rotation.from_euler("ZYX", angles)
    )


def table1_pair(
    index: int, seed: int, sigma2: float, scene: str = "floodgate", sensor: Sensor = TABLE1_SENSOR
) -> tuple[Scan, Scan, RigidTransform]:
    """The reference scan and S`index`, with the noise of the paper's Sect. 3, and the truth between them.

    Args:
        index: 0..9, the row of Table 1.
        seed: of the scene and of the noise; the reference scan is the same for every index.
        sigma2: variance of the range noise at the sensor's maximum range [m^2] (the paper: 1 and 2 voxels).
        scene: a key of SCENES.
        sensor: what to see with.

    Returns:
        target Scan (the reference), source Scan (S`index`), both in their own sensor frames (level with the
        grid, at TABLE1_RIG in it), and T_target_source between these. About the grid's center, the point
        -TABLE1_RIG of either sensor frame, it is table1_transform(index).
    """
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    T_target_source = T_grid_rig.inv() * table1_transform(index) * T_grid_rig
    target = _scan(scene, seed, sensor, T_grid_rig, 0, sigma2, "Sr")
    source = _scan(scene, seed, sensor, T_grid_rig * T_target_source, index + 1, sigma2, f"S{index}")
    return target, source, T_target_source


def _scan(
    scene: str,
    seed: int,
    sensor: Sensor,
    T_world_sensor: RigidTransform,
    number: int,
    sigma2: float,
    name: str,
) -> Scan:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    echoes = cast(build_scene(scene, seed), sensor, T_world_sensor)
    return measure(echoes, sensor, Noise(sigma2=sigma2), rng, stamp=float(number), name=name)
