"""Where the sensor goes: a survey around a scene's structures, and the poses of the paper's Table 1."""

from types import MappingProxyType

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from slam.trajectory import Trajectory

TABLE1_COUNT = 10
TABLE1_STEP = (4.0, 8.0, 12.0)  # x, y, z a step [m]; one voxel of the paper's 256^3 grid is 1 m
TABLE1_STEP_DEG = (6.0, 1.0, 2.0)  # yaw, pitch, roll a step

# Where the sensor rig stands in the grid frame [m]: before the structure, above the water, its fan looking
# down. Chosen so that the overlap falls smoothly from 0.9 at S0 to a fifth at S9 (the paper's Fig. 19).
TABLE1_RIG = (-100.0, -30.0, 10.0)

# Closed paths through clear water: x, y, z [m] and heading [degrees from x toward y] of each corner
SURVEY_LOOPS = MappingProxyType(
    {
        "floodgate": (
            (-90, -40, -2, -10),
            (-56, -60, -2, 22),
            (-22, -56, -2, 52),
            (-14, -22, -2, 28),
            (-22, 8, -2, -16),
            (-56, 14, -2, 14),
            (-84, 8, -2, 40),
            (-98, -24, -2, 14),
        ),
        "harbor": (
            (-64, -62, -2, 20),
            (-22, -42, -2, 50),
            (18, -24, -2, 80),
            (42, 6, -2, 110),
            (46, -26, -2, 70),
            (34, -62, -2, 30),
            (-10, -80, -2, -10),
            (-48, -88, -2, -10),
        ),
        "clutter": (
            (-64, -20, 20, 10),
            (-30, -62, 20, 50),
            (34, -58, 20, 100),
            (66, 4, 20, 170),
            (22, 60, 20, 250),
            (-40, 48, 20, 300),
        ),
    }
)
SPACING = 9.0  # of a survey's scans along its path [m]

# Waves move the vessel: amplitude of each of the summed sines, for heave [m] and yaw, pitch, roll [degrees]
WAVE_AMPLITUDE = (0.2, 1.2, 1.0, 1.6)
WAVE_PERIODS = (3.7, 5.9, 11.3)  # in scans


def survey(scene: str, count: int, seed: int, spacing: float = SPACING) -> Trajectory:
    """Poses every `spacing` meters along the scene's closed path, with the motion of a small vessel.

    Where the path ends it begins again: a long survey revisits its places. Roll, pitch, yaw and heave follow
    sums of sines whose phases come from `seed`. Stamps count the scans: 0, 1, 2, ...

    Raises:
        InputError: a scene without a path, no scan, or a spacing that is not positive.
    """
    if scene not in SURVEY_LOOPS:
        raise InputError(f"no survey path is laid through {scene!r}; there are {', '.join(SURVEY_LOOPS)}")
    if count < 1 or not spacing > 0:
        raise InputError(f"a survey of {count} scans every {spacing:g} m; wanted at least 1 and a spacing > 0")
    places, heading = _along_loop(np.array(SURVEY_LOOPS[scene], float), spacing * np.arange(count))
    heave, yaw, pitch, roll = _waves(count, np.random.default_rng(np.random.SeedSequence([seed, 4])))
    angles = np.column_stack([heading + np.deg2rad(yaw), np.deg2rad(pitch), np.deg2rad(roll)])
    poses = RigidTransform.from_components(
        places + heave[:, None] * (0.0, 0.0, 1.0), Rotation.from_euler("ZYX", angles)
    )
    return Trajectory(np.arange(count, dtype=np.float64), poses)


def table1_transform(index: int) -> RigidTransform:
    """Row S`index` of Table 1: p_target = R p_source + t in the grid frame [m].

    R = Rz(yaw) Ry(pitch) Rx(roll). The grid is a cube of 256 m whose center is the origin; z is up.
    The reference scan is the target.
    """
    if not 0 <= index < TABLE1_COUNT:
        raise InputError(f"Table 1 has the scans S0 to S{TABLE1_COUNT - 1}; got index {index}")
    angles = (index + 1) * np.deg2rad(TABLE1_STEP_DEG)
    return RigidTransform.from_components((index + 1) * np.array(TABLE1_STEP), Rotation.from_euler("ZYX", angles))


def table1() -> Trajectory:
    """Sensor poses in the reference grid frame: the reference scan's, then S0..S9. Stamps count them."""
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    moved = [table1_transform(index) * T_grid_rig for index in range(TABLE1_COUNT)]
    return Trajectory(np.arange(1.0 + TABLE1_COUNT), RigidTransform.concatenate([T_grid_rig, *moved]))


def _along_loop(corners: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 3) [m] and headings (N,) [rad] after `way` (N,) [m] along a smooth closed path."""
    heading = np.deg2rad(corners[:, 3])
    knots = np.column_stack([corners[:, :3], np.cos(heading), np.sin(heading)])
    closed = np.concatenate([knots, knots[:1]])
    path = CubicSpline(np.arange(len(closed)), closed, bc_type="periodic")
    fine = np.linspace(0, len(corners), 200 * len(corners) + 1)
    step = np.linalg.norm(np.diff(path(fine)[:, :3], axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(step)])
    at = path(np.interp(way % length[-1], length, fine))
    return at[:, :3], np.arctan2(at[:, 4], at[:, 3])


def _waves(count: int, rng: np.random.Generator) -> np.ndarray:
    """Heave [m], yaw, pitch and roll [degrees] of each scan, (4, N)."""
    phase = rng.uniform(0, 2 * np.pi, (4, len(WAVE_PERIODS), 1))
    angle = 2 * np.pi * np.arange(count) / np.array(WAVE_PERIODS)[:, None] + phase
    return np.array(WAVE_AMPLITUDE)[:, None] * np.sin(angle).sum(axis=1)
