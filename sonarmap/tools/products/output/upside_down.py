"""Whether a map is upside down: level surfaces above the sonar, and motion that does not show which side is up.

A bed lies below the sonar; a hull or ice above it. A wall shows nothing. If the vehicle turns, tilts or changes depth,
the registrations agree with the navigation only if the scans are upright.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.navigation.contradictions import (
    UPSIDE_DOWN,
    Registered,
    measured_values,
    pair_costs,
)
from sonarmap.tools.files.readers.navigation.correction import Correction

_SAMPLE = 5_000  # points whose surface is fitted
_MOST = 200_000  # points among which their neighbors are sought
_NEIGHBORS = 16
_LEVEL = 0.9  # cosine of the angle between a surface's normal and the vertical, from which it is level
_FLAT = 0.2  # largest ratio of the smallest to the middle variance of neighbors on a surface
_BROAD = 0.1  # least ratio of the middle to the largest
_LEAST = 0.05  # share of the sample that has to lie on level surfaces
_ABOVE = 0.8  # share of these above the sonar, from which the map may be upside down
_DECISIVE = 36.0  # chi-squared by which registrations and navigation show that the scans are upright


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points of a part of a map."""

    points: np.ndarray  # (n, 3) in the part's frame [m]
    sonar: np.ndarray  # (n,) height of the sonar that saw each [m]


def map_clouds(result: SurveyResult) -> list[Cloud]:
    """The clouds of a finished map."""
    heights, maps = result.trajectory.T_world_sensor.translation[:, 2], result.maps
    return [Cloud(maps[c].points, heights[maps[c].scan]) for c in placed(result.components)]


def scan_clouds(result: SurveyResult, points: Sequence[np.ndarray]) -> list[Cloud]:
    """The clouds of scans of which there are a few `points` each, (n, 3) in the sensor's frame [m]."""
    T, clouds = result.trajectory.T_world_sensor, list[Cloud]()
    for c in placed(result.components):
        members = [k for k in result.components[c] if len(points[k])]
        if members:
            heights = [np.full(len(points[k]), T[k].translation[2]) for k in members]
            clouds.append(Cloud(np.concatenate([T[k].apply(points[k]) for k in members]), np.concatenate(heights)))
    return clouds


def upside_down(result: SurveyResult, scans: Sequence[Scan], clouds: Sequence[Cloud]) -> str:
    """Why the map may be upside down, and what to do; "" if nothing speaks for it, or depth or attitude is unknown."""
    known = np.array([p is not None and p.knows_attitude and p.knows_depth for p in (scan.prior for scan in scans)])
    if known.sum() < len(scans) / 2:
        return ""
    heights = np.concatenate([np.empty(0), *map(_heights, clouds)])
    share = float((heights > 0).mean()) if len(heights) else 0.0
    if share < _ABOVE or _upright_by(result, scans) > _DECISIVE:
        return ""
    return (
        f"the map may be upside down: {100 * share:.0f} % of its level surfaces lie above the sonar, as no bed does. "
        "The navigation's motion does not show which side is up. If z has the other sign give --frame, if the sonar "
        f"is mounted upside down {UPSIDE_DOWN}, and if it is a hull or ice --no-check-priors"
    )


def _heights(cloud: Cloud) -> np.ndarray:
    """Heights above the sonar [m] of points on level surfaces, of a sample of a cloud; empty if they are few of the
    sample."""
    points, sonar = (array[:: len(cloud.points) // _MOST + 1] for array in (cloud.points, cloud.sonar))
    if len(points) < _NEIGHBORS:
        return np.empty(0)
    chosen = np.arange(0, len(points), len(points) // _SAMPLE + 1)
    near = points[KDTree(points).query(points[chosen], _NEIGHBORS)[1]]
    spread = near - near.mean(axis=1, keepdims=True)
    variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    is_surface = (variances[:, 0] < _FLAT * variances[:, 1]) & (variances[:, 1] > _BROAD * variances[:, 2])
    level = is_surface & (np.abs(axes[:, 2, 0]) > _LEVEL)
    return (points[chosen, 2] - sonar[chosen])[level] if level.mean() >= _LEAST else np.empty(0)


def _upright_by(result: SurveyResult, scans: Sequence[Scan]) -> float:
    """Chi-squared of the registrations by which the navigation agrees better with the scans as they are than turned
    upside down; about 0 for level motion at one depth and heading."""
    edges = [edge for edge in result.edges if edge.is_registered]
    if not edges:
        return 0.0
    by_scans = [edge.registration.by_scans for edge in edges]
    registered = Registered(
        np.array([edge.i for edge in edges]),
        np.array([edge.j for edge in edges]),
        RigidTransform.concatenate([each.T_target_source for each in by_scans]),
        np.array([each.covariance for each in by_scans]),
    )
    values, sigmas = measured_values([scan.prior for scan in scans])
    both = values, Correction.of(UPSIDE_DOWN.values[0])(values)
    given, turned = (pair_costs(each, sigmas, registered)[:, 0].sum() for each in both)
    return float(turned - given)
