# pyright: strict, reportMissingTypeStubs=false
"""The largest part of a finished map, as scans are located in it."""

import numpy as np

from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.locate.surveyed_map import SurveyedMap
from sonarmap.tools.files.map_folder.folder import Map


def surveyed_map(folder: Map) -> SurveyedMap:
    """The largest part of the map: frame, points, and the poses from which they were seen."""
    part = folder.parts[0]
    return SurveyedMap(
        points=part.points,
        seen_by=np.searchsorted(part.scans, part.columns["scan"]),
        T_map_sensor=part.trajectory.T_world_sensor,
        covariances=part.covariances,
        voxel=folder.voxel,
        measured=np.array([part.knows(name) for name in MEASURED]),
    )
