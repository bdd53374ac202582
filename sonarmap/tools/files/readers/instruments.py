"""What a vehicle's instruments measure of a scan's pose: columns of an operator's file to a PosePrior and back.

In the file, as on a vehicle's displays: `roll_deg` is positive with the starboard (right) side down, `pitch_deg` with
the nose up, `heading_deg` runs clockwise from true North, of the sensor's forward axis (the aerospace order: heading,
then pitch, then roll; axes forward, right, down, in a world North, East, Down). `x_m` is East and `y_m` North of any
origin that the file's rows share, `depth_m` is positive down. The standard deviation of a column is in its unit, in
`roll_sigma_deg`, `depth_sigma_m` and so on. All of it is for the sensor: correct for its mounting on the vehicle first.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior

# The largest numbers that files may hold: beyond any use, and far below where squares overflow.
# Of a coordinate, a rotation's parts and a standard deviation [m, rad, degrees]: 80 times as wide as the Earth.
LARGEST = 1e9
LARGEST_STAMP = 1e19  # nanoseconds since 1970 are 1.8e18
LARGEST_INFORMATION = 1e30  # its inverse is the largest variance
LEAST_SIGMA = 1e-9  # [m, rad, degrees]; a quaternion is not shorter either
PRIORS = "priors.csv"  # as `sonarmap simulate` calls the file beside its scans
# In the order of PosePrior's sigmas
COLUMNS = ("roll_deg", "pitch_deg", "heading_deg", "x_m", "y_m", "depth_m")
# What gives them where a file has none, in words.
PRIOR_SIGMAS = "--prior-sigmas A,H,D,P (attitude, heading [deg], depth, position [m]), as in --prior-sigmas 0.5,3,0.1,3"
SIGMA_COLUMNS = tuple("_sigma_".join(column.rsplit("_", 1)) for column in COLUMNS)

# Of what is measured, and of every standard deviation
LARGEST_OF = {"roll_deg": 180.0, "pitch_deg": 90.0, "heading_deg": 360.0}

_UNITS = np.array([np.pi / 180] * 3 + [1.0] * 3)  # of the columns, in radians and meters


def largest_of(column: str) -> float:
    """How large the numbers of a column may be, by its name: a stamp or id, an information (I11, ...), or any other."""
    if column.startswith("I"):
        return LARGEST_INFORMATION
    return LARGEST_STAMP if column in ("stamp", "id") else LARGEST


def check_measured(column: str, number: float) -> None:
    """Refuse a number of a column, in its unit, that no instrument gives; NaN says that nothing was measured."""
    if column in SIGMA_COLUMNS and number < LEAST_SIGMA:
        raise InputError(f"{column} is {number:g}; wanted a standard deviation above 0, at least {LEAST_SIGMA:g}")
    if abs(number) > (largest := LARGEST_OF.get(column, LARGEST)):
        unit = "degrees" if column.endswith("deg") else "meters"
        raise InputError(f"{column} is {number:g}; wanted {unit} within {largest:g}")


def prior_of(values: np.ndarray, sigmas: np.ndarray) -> PosePrior:
    """The prior of a row: (6,) values in the columns' order and units, NaN where not measured, and their standard
    deviations."""
    known = np.isfinite(values)
    measured = np.where(known, sigmas, np.inf).astype(np.float64) * _UNITS
    return PosePrior(poses_of(np.where(known, values, 0.0)[None])[0], measured)


def poses_of(values: np.ndarray) -> RigidTransform:
    """The n poses T_world_sensor (world East-North-Up, sensor x forward, y left, z up) of (n, 6) finite values."""
    roll, pitch, heading, x, y, depth = np.asarray(values, np.float64).T
    # y and z point the other way and the heading starts at North: yaw = 90 - heading, the pitch changes its sign
    angles = np.column_stack([90.0 - heading, -pitch, roll])
    return RigidTransform.from_components(
        np.column_stack([x, y, -depth]), Rotation.from_euler("ZYX", angles, degrees=True)
    )


def values_of(T_world_sensor: RigidTransform) -> np.ndarray:
    """(6,), or (n, 6) of n poses, in the columns' order and units: the inverse of `poses_of`, heading in [0, 360)."""
    yaw, pitch, roll = np.moveaxis(T_world_sensor.rotation.as_euler("ZYX", degrees=True), -1, 0)
    x, y, z = np.moveaxis(T_world_sensor.translation, -1, 0)
    return np.stack([roll, -pitch, (90.0 - yaw) % 360.0, x, y, -z], axis=-1)


def sigmas_of(prior: PosePrior) -> np.ndarray:
    """(6,) standard deviations in the columns' order and units, inf where not measured."""
    return prior.sigmas / _UNITS
