"""Where the sensor was when it saw each point: from the points' times and a trajectory in the points' frame."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.clouds.cloud import TIME_NAMES, Cloud
from sonarmap.tools.files.readers.poses.trajectory import places_at
from sonarmap.tools.files.readers.poses.tum import read_tum

TRAJECTORY = ".tum"
_COARSEST = 0.01  # seconds between two numbers of a point's time; a vehicle moves centimeters in it


def with_viewpoints(cloud: Cloud, path: Path) -> Cloud:
    """The cloud with a viewpoint per point, interpolated between the positions of the trajectory at `path`: a TUM file
    whose poses are T_scan_sensor, by the clock of the cloud's times [s].

    A cloud that has viewpoints keeps them, and one without times stays as it is; a note says so.

    Raises InputError: the trajectory cannot be used, its stamps do not ascend, or points were seen outside of its time.
    """
    if cloud.viewpoints is not None:
        return replace(cloud, notes=(*cloud.notes, f"{path.name} is not used: the points have viewpoints of their own"))
    if cloud.times is None:
        note = f"{path.name} is not used: the points have no time (a field {' or '.join(TIME_NAMES)})"
        return replace(cloud, notes=(*cloud.notes, note))
    trajectory = read_tum(path)
    if not (np.diff(trajectory.stamps) > 0).all():
        later = int(np.argmin(np.diff(trajectory.stamps) > 0)) + 1
        raise InputError(f"{path}: the stamps do not ascend (pose {later}); sort its lines")
    _require_within(cloud, cloud.times, trajectory, path)
    return replace(cloud, viewpoints=places_at(trajectory, cloud.times.astype(np.float64)))


def _require_within(cloud: Cloud, times: np.ndarray, trajectory: Trajectory, path: Path) -> None:
    first, last = trajectory.stamps[0], trajectory.stamps[-1]
    if times.dtype.kind == "f" and np.spacing(np.abs(times[np.isfinite(times)]).max(initial=0)) > _COARSEST:
        raise InputError(
            f"the points' times are {times.dtype}, too coarse for numbers as large as these; write them as float64 "
            f"(double), or count them, and those of {path.name}, from the scan's start"
        )
    with np.errstate(invalid="ignore"):
        finite = np.isfinite(cloud.points).all(axis=1)  # the others are dropped, whatever their time
    outside = finite & ~((times >= first) & (times <= last))  # NaN is outside too
    if outside.any():
        raise InputError(
            f"{int(outside.sum()):,} of {len(times):,} points have times outside of {path.name} (the points from "
            f"{times[finite].min():.6f} to {times[finite].max():.6f} s, the trajectory from {first:.6f} to {last:.6f} "
            "s); give both in seconds by one clock, and a trajectory that covers the scan, or remove the trajectory"
        )
