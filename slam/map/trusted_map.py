"""The map of a component as users get it: fused, and without the points that free space contradicts."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from slam.map.beams import Beams, beams_of
from slam.map.free_space import clear
from slam.map.point_map import PointMap, fuse
from spectral.scan import Scan


def trusted_map(
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    voxel: float,
    indices: Sequence[int] | None = None,
    covariances: np.ndarray | None = None,
    surveys: Sequence[int] | None = None,
    beams: Sequence[Beams] | None = None,
) -> PointMap:
    """Fuse scans and take out what free space contradicts; the arguments are those of `slam.map.point_map.fuse`."""
    beams = [beams_of(scan.points, voxel) for scan in scans] if beams is None else beams
    fused = fuse(scans, T_world_sensor, voxel, indices, covariances=covariances, surveys=surveys, beams=beams)
    return clear(fused, scans, T_world_sensor, covariances, beams)


def survey_layers(
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    voxel: float,
    indices: Sequence[int],
    covariances: np.ndarray,
    surveys: Sequence[int],
    beams: Sequence[Beams] | None = None,
) -> dict[int, PointMap]:
    """One map for each survey, of its own scans alone, by its number; none where there is only one survey.

    In the map of all, a survey may contradict what an earlier one saw and what has changed since: a layer is the
    place as that survey found it.
    """
    numbers = sorted(set(surveys))
    if len(numbers) < 2:
        return {}
    layers = {}
    for number in numbers:
        chosen = [k for k, survey in enumerate(surveys) if survey == number]
        layers[number] = trusted_map(
            [scans[k] for k in chosen],
            T_world_sensor[chosen],
            voxel,
            [indices[k] for k in chosen],
            covariances[chosen],
            [number] * len(chosen),
            None if beams is None else [beams[k] for k in chosen],
        )
    return layers
