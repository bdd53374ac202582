"""Trajectories of a sensor: surveys, loops and lanes through a scene, and the poses of the paper's Table 1."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.simulate.routes import gate_path, lawnmower_path, survey_path
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.scenes.scene import Scene, build_scene
from sonarmap.tools.lab.simulate.sensing.navigation import entropy_of
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor, bare
from sonarmap.tools.lab.simulate.smooth_path import Path
from sonarmap.tools.lab.simulate.viewpoints import shared_view

SHIFT = (3 - np.sqrt(5.0)) / 2  # of a dive's start against the previous dive's, as a share of the distance covered
DIVING = ("survey", "loop", "lawnmower")  # trajectories with several dives: those along a closed path

# Sideways drift of a dive other than the first in a scene of 256 m: amplitude of each of the summed sines [m]. Drift
# and heave stay within the clearance of the paths.
DRIFT_AMPLITUDE = 0.75
DRIFT_PERIODS = (23.0, 41.0)  # in scans
_DRIFT = 38  # stream of the seed


def check_dive(dive: int, trajectory: str) -> None:
    """Check a dive's number. Raises InputError: it is below 1, or above it for a trajectory that has only one dive."""
    if dive < 1:
        raise InputError(f"the dive is {dive}; wanted a number >= 1")
    if dive > 1 and trajectory not in DIVING:
        raise InputError(
            f"the trajectory {trajectory} has only one dive, and dive {dive} was asked for; leave it out, or choose "
            f"one of {', '.join(DIVING)}"
        )


def start_of(covered: float, dive: int) -> float:
    """Distance [m] at which a dive of length `covered` [m] begins, by the golden ratio, so that no two are close."""
    return float(covered * (SHIFT * (dive - 1) % 1))


def drift(count: int, seed: int, dive: int) -> np.ndarray:
    """Offset (N,) of a dive's scans to the left of its path, [m] in a scene of 256 m; 0 on the first dive."""
    if dive == 1:
        return np.zeros(count)
    rng = np.random.default_rng(np.random.SeedSequence(entropy_of(seed, _DRIFT, dive=dive)))
    return DRIFT_AMPLITUDE * _sines(count, DRIFT_PERIODS, (), rng)


def _sines(count: int, periods: tuple[float, ...], shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Sums (*shape, N) of sines of these periods, in scans, with random phases."""
    phase = rng.uniform(0, 2 * np.pi, (*shape, len(periods), 1))
    return np.sin(2 * np.pi * np.arange(count) / np.array(periods)[:, None] + phase).sum(axis=-2)


TABLE1_COUNT = 10  # rows of the table, S0 to S9
TABLE1_MOST = 13  # rows of the table and its continuation, S0 to S12
TABLE1_STEP = (4.0, 8.0, 12.0)  # x, y, z per row [m]; one voxel of the paper's 256^3 grid is 1 m
TABLE1_STEP_DEG = (6.0, 1.0, 2.0)  # yaw, pitch, roll per row

# Position of the sensor rig in the grid frame [m]: before the structure, above the water, its fan looking
# down. Chosen so that the overlap falls smoothly from 0.9 at S0 to a fifth at S9 (the paper's Fig. 19).
TABLE1_RIG = (-100.0, -30.0, 10.0)

SPACING = 9.0  # between a survey's scans along its path in a scene of 256 m [m]
LOOP_LEAST = 3  # least number of scans of a loop

# Waves move the vessel: amplitude of each of the summed sines, for heave [m] and yaw, pitch, roll [degrees]
WAVE_AMPLITUDE = (0.2, 1.2, 1.0, 1.6)
WAVE_PERIODS = (3.7, 5.9, 11.3)  # in scans
LOOKING_ROUND = 12.0  # period of a sensor that turns to and fro, in scans


def along(
    route: Callable[[str, int, float], Path],
    scene: str,
    count: int,
    seed: int,
    spacing: float = SPACING,
    dive: int = 1,
    reach: float = np.inf,
) -> Trajectory:
    """Poses every `spacing` meters, round and round a scene's closed path, with the motion of a small vessel.

    Roll, pitch, yaw and heave follow sums of sines whose phases come from `seed`. Stamps count the scans. Raises
    InputError: no scan, or a spacing that is not positive.
    """
    if count < 1 or not 0 < spacing < np.inf:
        raise InputError(f"{count} scans every {spacing:g} m; wanted at least 1 and a spacing > 0")
    path = route(scene, seed, reach)
    distance = start_of(min(count * spacing, path.length), dive) + spacing * np.arange(count)
    return Trajectory(np.arange(count, dtype=np.float64), poses_along(path, distance, scene, seed, dive))


survey, lawnmower = partial(along, survey_path), partial(along, lawnmower_path)


def loop(scene: str, count: int, seed: int, dive: int = 1, reach: float = np.inf) -> Trajectory:
    """Poses once round the path of `survey`: the last is one step from the first. Raises InputError: fewer than 3
    scans."""
    if count < LOOP_LEAST:
        raise InputError(f"a loop of {count} scans; wanted at least {LOOP_LEAST}")
    return survey(scene, count, seed, survey_path(scene, seed, reach).length / count, dive, reach)


def looking_round(trajectory: Trajectory, turn: float) -> Trajectory:
    """The trajectory with the sensor also turning to and fro about its z axis, by at most `turn` [rad] per scan."""
    swing = turn * LOOKING_ROUND / (2 * np.pi) * np.sin(2 * np.pi / LOOKING_ROUND * trajectory.stamps)
    R = RigidTransform.from_rotation(Rotation.from_euler("z", swing[:, None]))
    return Trajectory(trajectory.stamps, trajectory.T_world_sensor * R)


def poses_along(path: Path, distance: np.ndarray, scene: str, seed: int, dive: int = 1) -> RigidTransform:
    """N poses T_world_sensor at the distances (N,) [m] along `path`, of a vessel that waves move.

    Waves and drift of pose k depend only on k, the seed, the dive and the scene's size.
    """
    places, heading = path.at(distance)
    rng = np.random.default_rng(np.random.SeedSequence(entropy_of(seed, 4, dive=dive)))
    waves = np.array(WAVE_AMPLITUDE)[:, None] * _sines(len(distance), WAVE_PERIODS, (4,), rng)
    heave, yaw, pitch, roll = waves
    scale = scene_kind(scene).scale
    aside = scale * drift(len(distance), seed, dive)
    moved = np.column_stack([-aside * np.sin(heading), aside * np.cos(heading), scale * heave])
    angles = np.column_stack([heading + np.deg2rad(yaw), np.deg2rad(pitch) + path.pitch, np.deg2rad(roll)])
    return RigidTransform.from_components(places + moved, Rotation.from_euler("ZYX", angles))


def table1_transform(index: int) -> RigidTransform:
    """Row S`index` of Table 1: p_target = R p_source + t in the grid frame [m], R = Rz(yaw) Ry(pitch) Rx(roll).

    The grid is a cube of 256 m whose center is the origin; z is up. The reference scan is the target. The table ends
    with S9; S10 to S12 continue it with the same steps. Raises InputError: an index below 0 or above 12.
    """
    if not 0 <= index < TABLE1_MOST:
        raise InputError(
            f"Table 1 has the scans S0 to S{TABLE1_COUNT - 1}, and goes on to S{TABLE1_MOST - 1}; got index {index}"
        )
    angles = (index + 1) * np.deg2rad(TABLE1_STEP_DEG)
    return RigidTransform.from_components((index + 1) * np.array(TABLE1_STEP), Rotation.from_euler("ZYX", angles))


def table1(rows: int = TABLE1_COUNT) -> Trajectory:
    """Sensor poses in the reference grid frame: the reference scan's, then S0..S9, or `rows` of them, 1 to 13.

    Stamps count the scans. From S9 on the sensor is above the cube of 256 m, at S12 by 46 m, but its points are inside.
    """
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    moved = [table1_transform(index) * T_grid_rig for index in range(rows)]
    return Trajectory(np.arange(1.0 + rows), RigidTransform.concatenate([T_grid_rig, *moved]))


def first_of_table1(count: int) -> Trajectory:
    """The first `count` poses of `table1`. Raises InputError: a count below 1 or above 14."""
    poses = table1(TABLE1_MOST)
    if not 1 <= count <= len(poses):
        raise InputError(
            f"Table 1 has {1 + TABLE1_COUNT} scans, the reference and S0 to S{TABLE1_COUNT - 1}, and with S10 to "
            f"S{TABLE1_MOST - 1} {len(poses)}; {count} were asked for"
        )
    return poses.take(range(count))


GATE = "floodgate"
PAPER_COUNT = 18
MOST_SHARED, LEAST_SHARED = 0.88, 0.52  # wanted overlap of consecutive scans; the paper: about 90 to 50 percent
GOLDEN = (np.sqrt(5.0) - 1) / 2
STEP = 1.0  # of the search along a path in a scene of 256 m [m]
COLUMNS, ROWS = 64, 48  # largest numbers of beams with which overlap is measured


def paper18(scene: str, count: int, seed: int, sensor: Sensor) -> Trajectory:
    """Up to 18 poses, each as far along a path as its wanted overlap with the previous one allows.

    The overlap is `shared_view`, measured on the noise-free scene with fewer beams; the wanted values vary between 0.9
    and 0.5 in a fixed order. The path shows the gate from shore to shore; the vessel moves as in `survey`. Raises
    InputError: fewer scans than 1 or more than 18, another scene, or a path that is too short.
    """
    if not 1 <= count <= PAPER_COUNT:
        raise InputError(f"the paper's survey has {PAPER_COUNT} scans; {count} were asked for")
    if scene != GATE:
        raise InputError(f"the paper's survey is of the scene {GATE}, not {scene}; choose a survey or a lawnmower")
    path = gate_path()
    coarse = replace(bare(sensor), columns=min(sensor.columns, COLUMNS), rows=min(sensor.rows, ROWS))
    # wanted overlaps, spread evenly between the greatest and the least in a fixed order
    shares = MOST_SHARED - (MOST_SHARED - LEAST_SHARED) * np.sqrt(GOLDEN * np.arange(1, count) % 1)
    distance = stations(build_scene(scene, seed), path, coarse, shares, seed)
    return Trajectory(np.arange(count, dtype=np.float64), poses_along(path, distance, scene, seed))


def stations(scene: Scene, path: Path, sensor: Sensor, shares: np.ndarray, seed: int) -> np.ndarray:
    """Distances (N + 1,) [m] of scans along `path`: each is the last one before the `shared_view` of the scan and the
    previous one falls below its share, of `shares` (N,), 0..1. Raises InputError: the path is too short."""
    step = STEP * scene.kind.scale
    distance = [0.0]

    def last_pose(distance: list[float]) -> RigidTransform:
        return poses_along(path, np.array(distance), scene.name, seed)[-1]

    for share in shares:
        before, gone = last_pose(distance), distance[-1] + step
        while shared_view(scene, sensor, before, last_pose([*distance, gone + step])) >= share:
            gone += step
            if gone > path.length:
                raise InputError(f"the path through {scene.name} ends after {len(distance)} of {len(shares) + 1} scans")
        distance.append(gone)
    return np.array(distance)
