# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Pose graphs from a map's graph.json."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.json_file import read_json
from sonarmap.tools.files.readers.limits import LEAST_SIGMA
from sonarmap.tools.files.readers.poses.pose_rows import rigid_transform

FORMAT = "sonarmap graph 1"


def read_graph_json(path: Path) -> PoseGraph:
    """The graph as the map had it: poses, edges, priors, control points. Raises InputError: no such file, or one that
    is not a map's graph.json."""
    content = read_json(path, "the graph.json of a map")
    try:
        if content["format"] != FORMAT:
            raise InputError(f"{path} is of format {content['format']!r}; wanted {FORMAT!r}")
        trajectory = trajectory_of(content["poses"])
        edges = tuple(_edge(row) for row in content["edges"])
        priors = tuple((int(row["pose"]), _prior(row)) for row in content["priors"])
        control = tuple(_control(row) for row in content.get("control_points", ()))
        return PoseGraph(trajectory, edges, priors=priors, control=control)
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(f"{path} is not the graph.json of a map ({error})") from error


def trajectory_of(poses: Any) -> Trajectory:
    """The poses as graph.json lists them. Raises InputError: no rigid transform; ValueError, LookupError, TypeError."""
    T = RigidTransform.concatenate([rigid_transform(pose["T_world_sensor"], "a pose") for pose in poses])
    return Trajectory(np.array([pose["stamp"] for pose in poses], dtype=np.float64), T)


def _edge(row: dict[str, Any]) -> Edge:
    T = rigid_transform(row["T_i_j"], "an edge")
    probability = np.nan if row["probability"] is None else float(row["probability"])
    covariance = np.array(row["covariance"])
    measured = Registration(T, covariance, np.nan, np.nan, True, 0.0, str(row["reason"]), probability)
    return Edge(int(row["i"]), int(row["j"]), measured, row["kind"])


def _control(row: dict[str, Any]) -> ControlPoint:
    point, known, sigmas = (np.array(row[name], dtype=np.float64) for name in ("point", "known", "sigmas"))
    return ControlPoint(str(row["name"]), int(row["pose"]), point, known, sigmas)


def _prior(row: dict[str, Any]) -> PosePrior:
    sigmas = np.array([np.inf if sigma is None else sigma for sigma in row["sigmas"]], dtype=np.float64)
    if not (sigmas >= LEAST_SIGMA).all():
        raise InputError(f"a prior has the standard deviation {sigmas.min():g}; wanted at least {LEAST_SIGMA:g}")
    return PosePrior(rigid_transform(row["T_world_sensor"], "a prior"), sigmas)
