"""A decided survey as a result, with the uncertainty of every pose; its components may be fused to maps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sonarmap.slam.decide.decision import Decision
from sonarmap.slam.graph.pose_covariance import pose_covariances
from sonarmap.slam.map.doubtful_points import ComponentMaps, component_maps
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.scan import Scan


def fused(
    decision: Decision, scans: Sequence[Scan], surveys: np.ndarray, voxel: float, map_voxel: float, min_seen: int
) -> SurveyResult:
    """The result of a survey, with the maps of all components.

    Args:
        scans, surveys: N, and (N,) the number of each one's survey.
        voxel, map_voxel: edges of the survey's and the maps' voxels [m].
        min_seen: points that fewer scans saw are left out where others contradict them.
    """
    result = unfused(decision, scans, surveys, voxel)
    trajectory, covariances, components = result.trajectory, result.covariances, result.components
    parts: list[ComponentMaps] = []
    for component in components:
        members = list(component)
        placed = PlacedScans.of(
            [scans[k] for k in members],
            trajectory.T_world_sensor[members],
            map_voxel,
            members,
            covariances[members],
            surveys[members].tolist(),
        )
        parts.append(component_maps(placed, decision.chained.take(members), min_seen))
    return replace(result, parts=tuple(parts))


def unfused(decision: Decision, scans: Sequence[Scan], surveys: np.ndarray, voxel: float) -> SurveyResult:
    """The result of a survey, with its trajectory but without maps. Arguments: see `fused`."""
    return SurveyResult(
        trajectory=decision.solution.trajectory,
        chained=decision.chained,
        components=decision.solution.graph.components,
        surveys=tuple(surveys.tolist()),
        covariances=pose_covariances(decision.solution),
        solution=decision.solution,
        parts=(),
        pairs=decision.pairs,
        gaps=tuple((pair.i, pair.j) for pair in decision.pairs if pair.role == "sequential" and not pair.kept),
        voxel=voxel,
        wrong_fixes=decision.fixes.wrong,
        understated=decision.understated,
        systematic=decision.fixes.systematic,
        interpolated=decision.interpolated,
        other_places=decision.other_places,
        names=tuple(scan.name for scan in scans),
    )
