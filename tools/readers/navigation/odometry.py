# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Dead reckoning from a file, at its own times, interpolated to the scans'."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Slerp

from kernels.errors import InputError
from slam.graph.trajectory import Trajectory
from slam.motion.odometry import Odometry
from spectral.scan import Scan
from tools.readers.bags.open import is_recording
from tools.readers.bags.poses import read_recorded_odometry
from tools.readers.csv_table import read_csv_table
from tools.readers.instruments import COLUMNS, check_measured, pose_of
from tools.readers.limits import LARGEST, LEAST_SIGMA
from tools.readers.navigation.match import SAME_STAMP, seconds
from tools.readers.poses.tum import read_tum
from tools.readers.selection import part_of_file

# Poses this many times farther apart than usual leave a gap, in which nothing is known.
_GAP = 10.0


def read_odometry(
    path: Path, scans: Sequence[Scan], drift: float, turn_drift: float, notes: list[str] | None = None
) -> Odometry:
    """Where dead reckoning has the scans.

    Args:
        path: a TUM file, a CSV file (by its suffix) with the columns stamp and those of a priors file, all filled, or a
            ROS bag or MCAP file, perhaps with ::TOPIC behind it.
        scans: with stamps by the same clock.
        drift: standard deviation of the way, as a share of it.
        turn_drift: standard deviation of the rotation [rad/s].
        notes: what a user should know of the file is added to it.

    Raises:
        InputError: naming the file: it cannot be used, its stamps do not ascend, or fewer than two scans lie within its
            time.
    """
    trajectory = _read_trajectory(path, [] if notes is None else notes)
    stamps = trajectory.stamps
    if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
        pose = int(np.argmin(np.diff(stamps) > 0)) + 1 if len(stamps) > 1 else 0
        raise InputError(
            f"{path}: wanted two poses or more with stamps that ascend; pose {pose} does not; sort its rows"
        )
    times = np.array([scan.stamp for scan in scans], dtype=np.float64)
    told = _within(stamps, times)
    if told.sum() < 2:
        raise InputError(
            f"{path} tells of {int(told.sum())} of the {len(scans)} scans: it runs from {stamps[0]:.3f} to "
            f"{stamps[-1]:.3f} s, the scans from {times.min():.3f} to {times.max():.3f} s; wanted stamps of one clock"
        )
    if notes is not None and not told.all():
        bare = [scans[k].name for k in np.flatnonzero(~told).tolist()]
        notes.append(f"{path} tells nothing of {len(bare)} of {len(scans)} scans: {bare[0]}{' ...' * (len(bare) > 1)}")
    indices = np.flatnonzero(told)
    at = np.clip(times[indices], stamps[0], stamps[-1])
    places, R = trajectory.T_world_sensor.translation, trajectory.T_world_sensor.rotation
    translation = np.column_stack([np.interp(at, stamps, places[:, axis]) for axis in range(3)])
    poses = RigidTransform.from_components(translation, Slerp(stamps, R)(at))
    return Odometry(indices, poses, times[indices], drift, turn_drift)


def _within(stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(N,) bool: which times lie between two poses that are not far apart, or at one."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    gap = stamps[after] - stamps[after - 1]
    inside = (times >= stamps[0]) & (times <= stamps[-1]) & (gap <= _GAP * np.median(np.diff(stamps)))
    nearest = np.minimum(np.abs(times - stamps[after]), np.abs(times - stamps[after - 1]))
    return inside | (nearest <= SAME_STAMP)


def _read_trajectory(path: Path, notes: list[str]) -> Trajectory:
    part = part_of_file(str(path))
    if part is not None and is_recording(part.path):
        return read_recorded_odometry(part.path, part.topic, notes)
    return _read_csv(path) if path.suffix.lower() == ".csv" else read_tum(path)


def _read_csv(path: Path) -> Trajectory:
    table = read_csv_table(path)
    header = table.heading.cells
    missing = [column for column in ("stamp", *COLUMNS) if column not in header]
    if missing:
        raise InputError(
            f"{path}: line {table.heading.line}: odometry needs the columns stamp, {', '.join(COLUMNS)}; "
            f"{', '.join(missing)} not found"
        )
    table.require_even(path)
    stamps, poses = [], []
    for row in table.rows:
        cells = dict(zip(header, row.cells, strict=True))
        values = np.array([seconds(cells[column]) for column in ("stamp", *COLUMNS)])
        if not np.isfinite(values).all():
            empty = ("stamp", *COLUMNS)[int(np.argmin(np.isfinite(values)))]
            raise InputError(f"{path}: line {row.line}: {empty} is {cells[empty][:40]!r}; wanted a finite number")
        try:
            for column, value in zip(COLUMNS, values[1:].tolist(), strict=True):
                check_measured(column, value)
        except InputError as error:
            raise InputError(f"{path}: line {row.line}: {error}; fix that line") from error
        stamps.append(values[0])
        poses.append(pose_of(values[1:]))
    if not poses:
        raise InputError(f"{path} has no row below its heading")
    return Trajectory(np.array(stamps), RigidTransform.concatenate(poses))


def parse_drift(text: str, option: str = "--odometry-drift") -> tuple[float, float]:
    """The share of the way and the rotation per second [rad/s], from "percent,degrees per hour" of an option.

    Raises:
        InputError: not two numbers of 0 or more, one of them above 0.
    """
    try:
        percent, degrees = (float(part) for part in text.split(","))
    except ValueError:
        percent = degrees = -1.0
    if not (0 <= percent <= LARGEST and 0 <= degrees <= LARGEST and percent + degrees > LEAST_SIGMA):
        raise InputError(f"{option} is {text!r}; give percent of the way and degrees per hour, as in {option} 1,10")
    return percent / 100, float(np.radians(degrees)) / 3600
