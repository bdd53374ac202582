"""Dead reckoning at the scans' times from a file, and the turn rates that recordings' IMUs measured."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.bags.open import is_recording
from sonarmap.tools.files.readers.instruments import COLUMNS, LARGEST, LEAST_SIGMA, poses_of
from sonarmap.tools.files.readers.navigation.faults import fault_notes, usable_rows
from sonarmap.tools.files.readers.navigation.log import SAME_STAMP
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.recorded import recorded_turn_rates
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings
from sonarmap.tools.files.readers.navigation.why_apart import why_apart
from sonarmap.tools.files.readers.selection import is_bag_folder
from sonarmap.tools.files.readers.trajectory import poses_at

_GAP = 10.0  # ratio to the usual time between poses, from which on they are not interpolated


def read_odometry(
    path: Path,
    scans: Sequence[Scan],
    drift: float,
    turn_drift: float,
    notes: list[str] | None = None,
    settings: NavigationSettings = AS_IT_SAYS,
) -> Odometry:
    """Dead reckoning interpolated to the stamps of the scans, which are by the same clock.

    Args:
        path: a TUM file, a CSV file with times and all columns of a priors file, all filled, an SBET file, the reports
            of a DVL, or a ROS bag or MCAP file, optionally followed by ::TOPIC.
        drift: standard deviation of the distance, as a share of it; a larger one that the file states takes precedence.
        turn_drift: standard deviation of the rotation [rad/s].
    """
    notes = [] if notes is None else notes
    times = np.array([scan.stamp for scan in scans], dtype=np.float64)
    trajectory, stated = _trajectory(path, settings, times, notes)
    if stated > drift:
        notes.append(
            f"{path}: its standard deviation grows by {stated:.1%} of the distance, which is taken as its drift"
        )
    stamps = trajectory.stamps
    if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
        pose = int(np.argmin(np.diff(stamps) > 0)) + 1 if len(stamps) > 1 else 0
        raise InputError(f"{path}: wanted two poses or more with ascending stamps; pose {pose} is out of order")
    covered = _within(stamps, times)
    if covered.sum() < 2:
        raise InputError(f"{path} covers {int(covered.sum())} of the {len(scans)} scans: {why_apart(stamps, times)}")
    if not covered.all():
        bare = [scans[k].name for k in np.flatnonzero(~covered).tolist()]
        notes.append(f"{path} does not cover {len(bare)} of {len(scans)} scans: {bare[0]}{' ...' * (len(bare) > 1)}")
    indices = np.flatnonzero(covered)
    at = np.clip(times[indices], stamps[0], stamps[-1])
    return Odometry(indices, poses_at(trajectory, at), times[indices], max(drift, stated), turn_drift)


def _within(stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(N,) bool: times at a pose, or between two poses without a gap."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    gap = stamps[after] - stamps[after - 1]
    inside = (times >= stamps[0]) & (times <= stamps[-1]) & (gap <= _GAP * np.median(np.diff(stamps)))
    nearest = np.minimum(np.abs(times - stamps[after]), np.abs(times - stamps[after - 1]))
    return inside | (nearest <= SAME_STAMP)


def _trajectory(
    path: Path, settings: NavigationSettings, stamps: np.ndarray, notes: list[str]
) -> tuple[Trajectory, float]:
    """The poses of the sonar, in the frame of the dead reckoning, and the growth of their stated error, as a share of
    the distance."""
    log = read_navigation(path, settings, None, stamps, notes)
    missing = ["stamp"] * (log.key == "name")
    missing += [COLUMNS[k] for k in np.flatnonzero(np.isnan(log.values).all(axis=0)).tolist()]
    if missing:
        raise InputError(f"{path}: odometry needs times and {', '.join(COLUMNS)}; {', '.join(missing)} not found")
    usable, faults = usable_rows(log, settings.fastest, stamps - settings.offset)
    notes += [f"{path}: {note}" for note in fault_notes(faults)]
    faulty = np.isin(log.lines, [fault.line for fault in faults])
    for row, column in np.argwhere(np.isnan(log.values) & ~faulty[:, None]).tolist():
        raise InputError(f"{path}: line {log.lines[row]}: {COLUMNS[column]} is empty; odometry needs all in every row")
    values, sigmas = usable.values[~faulty], log.sigmas[~faulty, 3]
    way = float(np.linalg.norm(np.diff(values[:, 3:], axis=0), axis=1).sum())
    stated = (sigmas[-1] - sigmas[0]) / way if len(sigmas) and way > 0 else 0.0
    T_odom_vehicle = poses_of(values)
    T = T_odom_vehicle * settings.mount.T_vehicle_sensor if settings.mount else T_odom_vehicle
    return Trajectory(log.times[~faulty] + settings.offset, T), float(np.nan_to_num(stated))


def parse_drift(text: str, option: str = "--odometry-drift") -> tuple[float, float]:
    """Parse an option's "PERCENT,DEGREES_PER_HOUR" to a share of the distance and a rotation [rad/s]."""
    try:
        percent, degrees = (float(part) for part in text.split(","))
    except ValueError:
        percent = degrees = -1.0
    if not (0 <= percent <= LARGEST and 0 <= degrees <= LARGEST and percent + degrees > LEAST_SIGMA):
        raise InputError(f"{option} is {text!r}; wanted percent of the distance, degrees per hour, as in {option} 1,10")
    return percent / 100, float(np.radians(degrees)) / 3600


def turn_rates_of(files: Sequence[Path], scans: Sequence[Scan]) -> TurnRates | None:
    """Turn rates of the IMUs of all recordings among `files`; None if no file has an IMU, or no scan has times for its
    points, so that none needs them."""
    if all(scan.times is None for scan in scans):
        return None
    measured: list[tuple[np.ndarray, np.ndarray]] = []
    for path in dict.fromkeys(path.parent if is_bag_folder(path.parent) else path for path in files):
        with suppress(InputError):  # without an IMU
            if path.suffix.lower() == ".sonar":
                from sonarmap.tools.files.readers.sonar.recording import turn_rates

                measured.append(turn_rates(path))
            elif is_recording(path):
                measured.append(recorded_turn_rates(path))
    if not measured:
        return None
    times, rates = (np.concatenate(columns) for columns in zip(*measured, strict=True))
    times, first = np.unique(times, return_index=True)
    return TurnRates(times, rates[first]) if len(times) > 1 else None
