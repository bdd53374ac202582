"""Default settings for a scene and a trajectory: the sensor, and spacing and noise in proportion to its size."""

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate import trajectories
from sonarmap.tools.lab.simulate.routes import survey_path
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, PAPER, SENSORS, Sensor
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, observe

SPACED = ("survey", "lawnmower")  # trajectories with a spacing
LAWNMOWER_COUNT = 200
TABLE1_SENSOR: Sensor = replace(PAPER, tilt=float(np.deg2rad(30.0)))


def plan(scene: str, trajectory: str = "survey", sensor: str | None = None, seed: int = 0) -> SimulationSettings:
    """Default settings for a scene and a trajectory; `sensor` defaults to the one that suits the scene.

    The spacing is 9 m in a scene of 256 m, and proportionally less in a smaller scene or with a sensor of shorter range
    than the scene's. The standard deviation of the range is 1 m at 120 m, and proportionally less for a sensor of
    shorter range. The number of scans of a loop follows from the spacing. Raises InputError: an unknown name, or a
    sensor for the trajectory table1, which has its own.
    """
    kind = scene_kind(scene)
    if trajectory == "table1":
        if sensor is not None:
            raise InputError("the trajectory table1 has the paper's own sensor; leave the sensor out")
        return table1_settings(seed, 1.0, scene)
    chosen = kind.sensor if sensor is None else sensor
    if chosen not in SENSORS:
        raise InputError(f"no sensor is called {chosen!r}; there are {', '.join(SENSORS)}")
    settings = SimulationSettings(scene=scene, trajectory=trajectory, sensor=SENSORS[chosen], seed=seed)
    spacing = _spacing(scene, settings.sensor) if trajectory in SPACED else settings.spacing
    share = min(SENSORS[kind.sensor].max_range, settings.sensor.max_range) / ECLIPSE.max_range
    noise = replace(settings.noise, sigma2=settings.noise.sigma2 * share**2)
    return replace(settings, count=_count(settings), spacing=spacing, noise=noise)


def louder(settings: SimulationSettings, factor: float) -> SimulationSettings:
    """The same settings with `factor` times the standard deviation of the ranges."""
    return replace(settings, noise=replace(settings.noise, sigma2=settings.noise.sigma2 * factor**2))


def table1_settings(seed: int, sigma2: float, scene: str = "floodgate") -> SimulationSettings:
    """Settings for the reference scan and S0..S9 of Table 1, eleven scans, with the paper's noise."""
    return SimulationSettings(
        scene, "table1", trajectories.TABLE1_COUNT + 1, sensor=TABLE1_SENSOR, noise=Noise(sigma2=sigma2), seed=seed
    )


def _spacing(scene: str, sensor: Sensor) -> float:
    """Default distance between scans [m]."""
    kind = scene_kind(scene)
    return trajectories.SPACING * min(kind.scale, sensor.max_range / SENSORS[kind.sensor].max_range)


def _count(settings: SimulationSettings) -> int:
    """The default number of scans of the trajectory."""
    if settings.trajectory == "loop":
        path = survey_path(settings.scene, settings.seed, settings.sensor.max_range)
        return math.ceil(path.length / _spacing(settings.scene, settings.sensor))
    return {"lawnmower": LAWNMOWER_COUNT, "paper18": trajectories.PAPER_COUNT}.get(settings.trajectory, settings.count)


def table1_pair(index: int, seed: int, sigma2: float, scene: str = "floodgate") -> tuple[Scan, Scan, RigidTransform]:
    """The reference scan and S`index`, 0 to 12, with noise of variance `sigma2` at the maximum range (the paper's Sect.
    3: 1 and 2 voxels), and T_target_source between their sensor frames; the reference is the same for every index.

    The frames are level with the grid, at TABLE1_RIG in it. About the grid's center, the point -TABLE1_RIG of either
    frame, the transform is table1_transform(index).
    """
    settings = table1_settings(seed, sigma2, scene)
    T_grid_rig = RigidTransform.from_translation(trajectories.TABLE1_RIG)
    T_target_source = T_grid_rig.inv() * trajectories.table1_transform(index) * T_grid_rig
    poses = trajectories.table1(index + 1).T_world_sensor
    target = observe(settings, poses[0], 0, "Sr")
    source = observe(settings, poses[index + 1], index + 1, f"S{index}")
    return target, source, T_target_source
