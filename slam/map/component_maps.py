"""All maps of one component: of its optimized poses, of each survey alone, and of its chained poses to compare with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slam.graph.trajectory import Trajectory
from slam.map.beams import beams_of
from slam.map.crossing import CrossingError, crossing_error
from slam.map.point_map import PointMap, fuse
from slam.map.trusted_map import survey_layers, trusted_map
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
        optimized=trusted_map(scans, T_after, voxel, indices, covariances, surveys, beams),
        layers=survey_layers(scans, T_after, voxel, indices, covariances, surveys, beams),
        chained=fuse(scans, T_before, voxel, indices, surveys=surveys, beams=beams),
        chained_poses=chained,
        crossings=crossing_error(scans, T_before, T_after, voxel, indices, surveys),
    )
