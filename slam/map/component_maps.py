"""All maps of one component: of its optimized poses, of each survey alone, and of its chained poses to compare with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from slam.graph.trajectory import Trajectory
from slam.map.beams import Beams, beams_of
from slam.map.crossing import CrossingError, crossing_error
from slam.map.free_space import clear
from slam.map.point_map import PointMap, fuse
from spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class ComponentMaps:
    """The maps of n scans that edges join.

    Attributes:
        optimized: the map.
        layers: the map of each survey's scans alone, by the survey's number; none where there is one survey.
        chained: the map that the poses before the loops would give, in the same frame; nothing is taken out of it, as
            free space contradicts what drift draws twice.
        chained_poses: these n poses.
        crossings: how far overlapping passes lie apart, before and after.
    """

    optimized: PointMap
    layers: Mapping[int, PointMap]
    chained: PointMap
    chained_poses: Trajectory
    crossings: CrossingError


def component_maps(
    scans: Sequence[Scan],
    chained: Trajectory,
    optimized: Trajectory,
    covariances: np.ndarray,
    voxel: float,
    indices: Sequence[int],
    surveys: Sequence[int],
) -> ComponentMaps:
    """Fuse one component.

    Args:
        scans: n scans.
        chained, optimized: their n poses before and after the loops, in one frame.
        covariances: (n, 6, 6) of the optimized poses, rotation first [rad, m], body tangent.
        voxel: edge of a voxel [m].
        indices: what to call the scans.
        surveys: the survey that each belongs to.

    Raises:
        InputError: a voxel so small that no point is within reach.
    """
    T_before, T_after = chained.T_world_sensor, optimized.T_world_sensor
    beams = [beams_of(scan.points, voxel) for scan in scans]
    return ComponentMaps(
        optimized=cleared_map(scans, T_after, voxel, indices, covariances, surveys, beams),
        layers=survey_layers(scans, T_after, voxel, indices, covariances, surveys, beams),
        chained=fuse(scans, T_before, voxel, indices, surveys=surveys, beams=beams),
        chained_poses=chained,
        crossings=crossing_error(scans, T_before, T_after, voxel, indices, surveys),
    )


def cleared_map(
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
        layers[number] = cleared_map(
            [scans[k] for k in chosen],
            T_world_sensor[chosen],
            voxel,
            [indices[k] for k in chosen],
            covariances[chosen],
            [number] * len(chosen),
            None if beams is None else [beams[k] for k in chosen],
        )
    return layers
