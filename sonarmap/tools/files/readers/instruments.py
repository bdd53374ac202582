"""Instrument measurements of a scan's pose: conversion between the columns of an operator's file and a PosePrior.

The file follows the conventions of vehicle displays: `roll_deg` is positive with the starboard (right) side down,
`pitch_deg` with the nose up, and `heading_deg` is the heading of the sensor's forward axis, clockwise from true North
(aerospace order heading, pitch, roll; axes forward, right, down; world North-East-Down). `x_m` is East and `y_m` North
of an origin shared by the file's rows; `depth_m` is positive down. The columns `roll_sigma_deg`, `depth_sigma_m` and so
on are standard deviations in the same units. All values refer to the sensor: correct for its mounting first.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior

# The largest numbers that files may hold: beyond any useful value, and far below where squares overflow.
LARGEST = 1e9  # of a coordinate, a rotation or a standard deviation [m, rad, degrees]
LARGEST_STAMP = 1e19  # nanoseconds since 1970 are 1.8e18
LARGEST_INFORMATION = 1e30  # also the largest variance
MIN_ROWS = 12  # with a measurement, for its usual steps to be known
LEAST_SIGMA = 1e-9  # smallest standard deviation [m, rad, degrees], and smallest norm of a quaternion
PRIORS = "priors.csv"  # file that `sonarmap simulate` writes beside its scans
# In the order of PosePrior's sigmas
COLUMNS = ("roll_deg", "pitch_deg", "heading_deg", "x_m", "y_m", "depth_m")
# Words for messages: the option that gives sigmas for a file without sigma columns
PRIOR_SIGMAS = "--prior-sigmas A,H,D,P (attitude, heading [deg], depth, position [m]), as in --prior-sigmas 0.5,3,0.1,3"
SIGMA_COLUMNS = tuple("_sigma_".join(column.rsplit("_", 1)) for column in COLUMNS)

# Largest magnitude of measured angles [deg]; LARGEST for other columns
LARGEST_OF = {"roll_deg": 180.0, "pitch_deg": 90.0, "heading_deg": 360.0}

_UNITS = np.array([np.pi / 180] * 3 + [1.0] * 3)  # radians or meters per unit of each column


def largest_of(column: str) -> float:
    """Largest magnitude allowed in a column, by its name: a stamp or id, an information (I11, ...), or any other."""
    if column.startswith("I"):
        return LARGEST_INFORMATION
    return LARGEST_STAMP if column in ("stamp", "id") else LARGEST


def check_measured(column: str, number: float) -> None:
    """Raise InputError for a number, in the column's unit, that no instrument gives; NaN (not measured) is allowed."""
    if column in SIGMA_COLUMNS and number < LEAST_SIGMA:
        raise InputError(f"{column} is {number:g}; wanted a standard deviation above 0, at least {LEAST_SIGMA:g}")
    if abs(number) > (largest := LARGEST_OF.get(column, LARGEST)):
        unit = "degrees" if column.endswith("deg") else "meters"
        raise InputError(f"{column} is {number:g}; wanted {unit} within {largest:g}")


def prior_of(values: np.ndarray, sigmas: np.ndarray) -> PosePrior:
    """The pose prior of values (6,) and standard deviations (6,) in the order and units of COLUMNS; values are NaN
    where not measured."""
    known = np.isfinite(values)
    measured = np.where(known, sigmas, np.inf).astype(np.float64) * _UNITS
    return PosePrior(poses_of(np.where(known, values, 0.0)[None])[0], measured)


def poses_of(values: np.ndarray) -> RigidTransform:
    """Poses T_world_sensor (world East-North-Up, sensor x forward, y left, z up) of finite values (n, 6) of COLUMNS."""
    roll, pitch, heading, x, y, depth = np.asarray(values, np.float64).T
    # from forward-right-down to forward-left-up: yaw = 90 - heading, and the pitch changes its sign
    angles = np.column_stack([90.0 - heading, -pitch, roll])
    return RigidTransform.from_components(
        np.column_stack([x, y, -depth]), Rotation.from_euler("ZYX", angles, degrees=True)
    )


def values_of(T_world_sensor: RigidTransform) -> np.ndarray:
    """Values (6,), or (n, 6) of n poses, of COLUMNS: the inverse of `poses_of`, with the heading in [0, 360)."""
    yaw, pitch, roll = np.moveaxis(T_world_sensor.rotation.as_euler("ZYX", degrees=True), -1, 0)
    x, y, z = np.moveaxis(T_world_sensor.translation, -1, 0)
    return np.stack([roll, -pitch, (90.0 - yaw) % 360.0, x, y, -z], axis=-1)


def sigmas_of(prior: PosePrior) -> np.ndarray:
    """Standard deviations (6,) in the order and units of COLUMNS; inf where not measured."""
    return prior.sigmas / _UNITS
