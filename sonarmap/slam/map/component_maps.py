"""All maps of one component: of its optimized poses, of each survey alone, and of its chained poses to compare with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.beams import Beams, beams_of
from sonarmap.slam.map.crossing import CrossingError, crossing_error
from sonarmap.slam.map.doubt import MIN_SEEN, CleanMap, of_the_same_echoes, part_doubtful
from sonarmap.slam.map.free_space import uncontradicted, votes
from sonarmap.slam.map.point_map import PointMap, fuse
from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class ComponentMaps:
    """The maps of n scans that edges join.

    Attributes:
        optimized: the map.
        doubtful: the points that were left out of it, as too few scans saw them where others looked; None where that
            was not asked.
        layers: the map of each survey's scans alone, by the survey's number, and what is doubtful by these scans;
            none where there is one survey.
        chained: the map that the poses before the loops would give, in the same frame, of the echoes that make up the
            map: it is not judged itself, as free space contradicts what drift draws twice.
        chained_poses: these n poses.
        crossings: how far overlapping passes lie apart, before and after.
    """

    optimized: PointMap
    doubtful: PointMap | None
    layers: Mapping[int, CleanMap]
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
    min_seen: int = MIN_SEEN,
) -> ComponentMaps:
    """Fuse one component.

    Args:
        scans: n scans.
        chained, optimized: their n poses before and after the loops, in one frame.
        covariances: (n, 6, 6) of the optimized poses, rotation first [rad, m], body tangent.
        voxel: edge of a voxel [m].
        indices: what to call the scans, ascending.
        surveys: the survey that each belongs to.
        min_seen: scans that have to see a point where others looked; 1 leaves nothing out.

    Raises:
        InputError: a voxel so small that no point is within reach.
    """
    T_before, T_after = chained.T_world_sensor, optimized.T_world_sensor
    beams = [beams_of(scan.points, voxel) for scan in scans]
    parted = clean_map(scans, T_after, voxel, indices, covariances, surveys, beams, min_seen)
    before = fuse(scans, T_before, voxel, indices, surveys=surveys, beams=beams)
    asked = min_seen > 1
    if asked:
        before = of_the_same_echoes(before, parted.clean, T_before, T_after, indices)
    return ComponentMaps(
        optimized=parted.clean,
        doubtful=parted.doubtful if asked else None,
        layers=survey_layers(scans, T_after, voxel, indices, covariances, surveys, beams, min_seen),
        chained=before,
        chained_poses=chained,
        crossings=crossing_error(scans, T_before, T_after, voxel, indices, surveys),
    )


def clean_map(
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    voxel: float,
    indices: Sequence[int] | None = None,
    covariances: np.ndarray | None = None,
    surveys: Sequence[int] | None = None,
    beams: Sequence[Beams] | None = None,
    min_seen: int = MIN_SEEN,
) -> CleanMap:
    """Fuse scans, take out what free space contradicts, and part what too few scans saw where others looked.

    The arguments are those of `slam.map.point_map.fuse`, and of `slam.map.doubt.part_doubtful`.
    """
    beams = [beams_of(scan.points, voxel) for scan in scans] if beams is None else beams
    fused = fuse(scans, T_world_sensor, voxel, indices, covariances=covariances, surveys=surveys, beams=beams)
    vote = votes(fused, scans, T_world_sensor, covariances, beams, indices)
    kept = uncontradicted(fused, vote)
    cleared = replace(fused.take(kept), removed=int(np.count_nonzero(~kept)))
    return part_doubtful(cleared, vote.take(kept), min_seen)


def survey_layers(
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    voxel: float,
    indices: Sequence[int],
    covariances: np.ndarray,
    surveys: Sequence[int],
    beams: Sequence[Beams] | None = None,
    min_seen: int = MIN_SEEN,
) -> dict[int, CleanMap]:
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
        layers[number] = clean_map(
            [scans[k] for k in chosen],
            T_world_sensor[chosen],
            voxel,
            [indices[k] for k in chosen],
            covariances[chosen],
            [number] * len(chosen),
            None if beams is None else [beams[k] for k in chosen],
            min_seen,
        )
    return layers
