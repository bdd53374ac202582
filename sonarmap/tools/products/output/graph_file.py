"""The pose graph with all that a g2o file has no words for: graph.json, which loses nothing."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sonarmap.slam.map.crossing import Crossing
from sonarmap.slam.motion.straighten import Way
from sonarmap.slam.pair import Pair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.poses.trajectory import FORMAT
from sonarmap.tools.products.output.pairs_file import fields_of, pair_row, registration_of
from sonarmap.tools.products.output.summary import scan_rows

# What the numbers are, for whoever reads the file without these pages.
CONVENTIONS = {
    "T_world_sensor": "p_world = T p_sensor, 4x4 [m]; the world is East-North-Up where 'in_world', else the frame of "
    "the component's first pose; before_loops: as consecutive registrations and navigation alone place the scan",
    "T_i_j": "p_i = T p_j, 4x4 [m]; T_target_source likewise",
    "covariance": "6x6, rotation first [rad, m], of xi in T_true = T Exp(xi): body tangent of the pose, of j, or of "
    "the source",
    "crossings": "scans where the track crosses itself: how far apart they lie before and after the loops, medians "
    "and 90th percentiles [m]",
    "control_points": "that the map is fitted to: in the sensor's frame of their pose, and known East, North, Up [m]",
    "straightened_by": "the way by which scans whose points have times were straightened: the poses of the map before",
    "prior": "sigmas of roll, pitch, heading [rad], East, North, Up [m]; null where not measured",
}


def survey_graph(result: SurveyResult, names: Sequence[str]) -> dict[str, Any]:
    """The content of a survey's graph.json: poses, edges as weighed, every pair with its verdict, and priors."""
    graph = result.solution.graph
    component = {scan: number for number, members in enumerate(graph.components) for scan in members}
    measured = {pose for pose, _ in graph.priors} | {known.pose for known in graph.known}
    measured |= {point.scan for point in graph.control}
    in_world = [not measured.isdisjoint(members) for members in graph.components]
    keys = None if result.keys is None else set(result.keys)
    return {
        "format": FORMAT,
        "conventions": CONVENTIONS,
        "poses": [
            {
                **row,
                "component": component[k],
                "in_world": in_world[component[k]],
                "key_scan": keys is None or k in keys,
                "T_world_sensor": result.trajectory.T_world_sensor[k].as_matrix(),
                "T_world_sensor_before_loops": result.chained.T_world_sensor[k].as_matrix(),
            }
            for k, row in enumerate(scan_rows(result, names))
        ],
        "edges": [
            fields_of(edge, "i", "j", "kind")
            | {"T_i_j": edge.registration.T_target_source.as_matrix()}
            | fields_of(edge.registration, "covariance", "probability", "reason")
            for edge in graph.edges
        ],
        "pairs": [_pair_row(pair) for pair in result.pairs],
        "priors": [_prior_row(pose, prior) for pose, prior in graph.priors],
        "control_points": [
            {"name": point.name, "pose": point.scan, **fields_of(point, "point", "known", "sigmas")}
            for point in graph.control
        ],
        "wrong_fixes": [{"pose": fix.scan} | fields_of(fix, "kind", "sigmas", "place") for fix in result.wrong_fixes],
        "anchors": graph.anchors,
        "straightened_by": None if result.way is None else _way_row(result.way),
        "crossings": [_crossing_row(crossing) for part in result.parts for crossing in part.crossings.crossings],
    }


def _way_row(way: Way) -> Mapping[str, Any]:
    return {**fields_of(way, "runs", "bent", "turned"), "T_world_sensor": way.trajectory.T_world_sensor.as_matrix()}


def _pair_row(pair: Pair) -> Mapping[str, Any]:
    """A pair with its verdict and, unless it failed, with what was measured."""
    registration = registration_of(pair)
    row = pair_row(pair) | ({"by_hand": pair.by_hand, "note": pair.note} if pair.by_hand else {})
    if registration is None:
        return row
    return {
        **row,
        "T_target_source": registration.T_target_source.as_matrix(),
        "covariance": registration.covariance,
        "step_psr": dict(registration.step_psr),
    }


def _crossing_row(crossing: Crossing) -> Mapping[str, Any]:
    before, after = crossing.before, crossing.after
    apart = {"before_m": before.median, "before_90_m": before.most, "after_m": after.median, "after_90_m": after.most}
    return {"i": crossing.i, "j": crossing.j, **apart}


def _prior_row(pose: int, prior: PosePrior) -> Mapping[str, Any]:
    sigmas = [sigma if np.isfinite(sigma) else None for sigma in prior.sigmas.tolist()]
    return {"pose": pose, "T_world_sensor": prior.T_world_sensor.as_matrix(), "sigmas": sigmas}
