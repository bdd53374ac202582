# pyright: strict, reportMissingTypeStubs=false
"""The track at a steady rate, for formats that hold poses and not scans."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.tools.files.map_folder.folder import MapPart

_MOST = 10_000_000  # poses


def sampled(part: MapPart, surveys: np.ndarray, rate: float) -> MapPart:
    """The part with so many poses a second [Hz] between those of its scans, each with the number of the scan before it.

    Args:
        surveys: (n,) of its scans: from one to the next there is no way.

    Raises:
        InputError: stamps that do not ascend, or more than ten million poses.
    """
    stamps = part.trajectory.stamps
    if rate * np.ptp(stamps) > _MOST:
        raise InputError(
            f"--rate {rate:g} over {np.ptp(stamps):g} s gives more than {_MOST:,} poses; give a smaller rate"
        )
    chosen: list[int] = []
    trajectories: list[Trajectory] = []
    covariances: list[np.ndarray] = []
    for number in np.unique(surveys).tolist():
        own: np.ndarray = np.flatnonzero(surveys == number)
        knots, known = part.trajectory.take(own.tolist()), part.covariances[own]
        if len(own) > 1:
            first, last = knots.stamps[[0, -1]].tolist()
            asked: np.ndarray = first + np.arange(int((last - first) * rate) + 1) / rate
            knots, known = ContinuousTrajectory.through(knots, known).at(np.minimum(asked, last))
        chosen += own[np.searchsorted(stamps[own], knots.stamps, side="right") - 1].tolist()
        trajectories.append(knots)
        covariances.append(known)
    poses = RigidTransform.concatenate([each.T_world_sensor for each in trajectories])
    return replace(
        part,
        scans=tuple(part.scans[k] for k in chosen),
        trajectory=Trajectory(np.concatenate([each.stamps for each in trajectories]), poses),
        covariances=np.concatenate(covariances),
    )
