"""Small valid files of poses and settings of every kind, each with its reader."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.names import read_pairs
from sonarmap.tools.files.readers.constraints import read_control, read_ties
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.trajectory import FORMAT, read_graph_json, read_gt_log, read_kitti, read_tum
from sonarmap.tools.lab.evaluate.survey import SurveySummary, read_summary
from sonarmap.tools.lab.simulate.folder import read_settings

# Fields whose values may be unknown.
UNKNOWN = ("sigmas", "psr", "overlap", "probability")
SCANS = [Scan(np.ones((1, 3), np.float32), stamp=float(k), name=f"scan{k}") for k in range(3)]

_INFORMATION = " ".join("100" if i == j else "0.5" for i in range(6) for j in range(i, 6))
_TUM = "".join(f"{k}.0 {k * 1.5} 2.25 -0.5 0.1 0.2 0.3 0.9\n" for k in range(3))
_MATRIX = [[0.0, -1.0, 0.0, 1.5], [1.0, 0.0, 0.0, 2.5], [0.0, 0.0, 1.0, -3.5], [0.0, 0.0, 0.0, 1.0]]
_ROWS = "\n".join(" ".join(map(str, row)) for row in _MATRIX)
_COVARIANCE = np.diag([0.01, 0.01, 0.02, 0.5, 0.25, 0.125]).tolist()
_PRIORS = "roll_deg,roll_sigma_deg,pitch_deg,pitch_sigma_deg,x_m,x_sigma_m,y_m,y_sigma_m,depth_m,depth_sigma_m"
_PRIOR_ROW = "1.5,0.5,-2.5,0.5,10.5,3,20.5,3,7.5,0.1"
SYMBOL = ord("x") << 56  # of GTSAM, x0
_G2O = (
    "".join(f"VERTEX_SE3:QUAT {k} {k * 1.5} 2.25 -0.5 0.1 0.2 0.3 0.9\n" for k in range(3))
    + "".join(f"EDGE_SE3:QUAT {k} {k + 1} 1.5 0.25 0 0 0 0 1 {_INFORMATION}\n" for k in range(2))
    + f"FIX 0\nPARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\nEDGE_SE3_PRIOR 1 0 1.5 2 0 0 0 0 1 {_INFORMATION}\n"
)
# With the symbols x0, x1, x2 as ids, and priors without the number of an offset, behind a byte-order mark
GTSAM = "\ufeff" + (
    "".join(f"VERTEX_SE3:QUAT {SYMBOL + k} {k * 1.5} 2.25 -0.5 0.1 0.2 0.3 0.9\n" for k in range(3))
    + "".join(f"EDGE_SE3:QUAT {SYMBOL + k} {SYMBOL + k + 1} 1.5 0.25 0 0 0 0 1 {_INFORMATION}\n" for k in range(2))
    + f"EDGE_SE3_PRIOR:QUAT {SYMBOL + 1} 1.5 2 0 0 0 0 1 {_INFORMATION}\n"
)
_EDGE = {"i": 0, "j": 1, "T_i_j": _MATRIX, "covariance": _COVARIANCE, "probability": 0.9, "reason": "", "kind": "loop"}
_GRAPH = {
    "format": FORMAT,
    "poses": [{"stamp": float(k), "T_world_sensor": _MATRIX} for k in range(2)],
    "edges": [_EDGE],
    "priors": [{"pose": 0, "T_world_sensor": _MATRIX, "sigmas": [0.01, 0.01, None, None, None, 0.1]}],
}
_SUMMARY = {
    "settings": {"grid": {"voxel": 0.5}},
    "scans": [{"stamp": float(k), "covariance": _COVARIANCE} for k in range(2)],
    "pairs": {"tried": 2},
    "components": [{"scans": [0, 1], "map": {"voxel_m": 0.5}}],
}
_PAIRS = (
    "target,source,role,kept,reason,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg\n"
    '0,1,sequential,yes,"kept, as it is",1.5,-2.5,0.25,10.5,-20.5,170.25\n'
    "0,1,loop,no,failed,,,,,,\n"
)
_TIES = (
    "# by hand\ntarget,source,verdict,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,sigma_m,sigma_deg,note\n"
    "scan0,scan2,add,1.5,-2.5,0.25,10.5,-20.5,170.25,0.05,1.5,same pile\n"
    "scan1,scan0,reject,,,,,,,,,\n2,1,accept,,,,,,,,,\n"
)
_CONTROL = (
    "name,scan,x_m,y_m,z_m,east_m,north_m,depth_m,sigma_h_m,sigma_v_m,use\n"
    "A,scan0,1.5,-2.5,0.25,310.5,-20.25,12.5,0.05,0.1,control\nB,scan1,4.5,1.25,-3.5,320.5,-31.75,11.5,,,check\n"
)
_EARTH = (
    "name,scan,x_m,y_m,z_m,lat_deg,lon_deg,height_m,sigma_m\n"
    "A,scan0,1.5,-2.5,0.25,60.39131,5.32212,-12.5,0.05\nB,scan2,4.5,1.25,-3.5,60.39142,5.32231,-11.5,0.07\n"
)
_SENSOR = {"name": "own", "horizontal": 1.5, "vertical": 0.75, "columns": 32, "rows": 16, "min_range": 0.5}
_DESCRIPTION = {
    "settings": {
        "scene": "pool", "trajectory": "survey", "count": 3, "spacing": 1.5, "seed": 7, "dive": 1, "unusable": 0.25,
        "sensor": _SENSOR | {"max_range": 12.5, "tilt": 0.25, "edge_loss": 3.5, "threshold": 0.002},
        "noise": {"sigma2": 0.01, "outliers": 0.01, "dropouts": 0.05, "ghosts": 0.02, "speckle": 1.0, "lobe": 0.5},
    }
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Readable:
    """A valid file with its reader, which also checks the result, and raises InputError for a file that it refuses."""

    name: str
    content: bytes
    read: Callable[[Path], object]


def _csv(key: str) -> bytes:
    cells = ["scan0", "scan1"] if key == "name" else ["0", "1.0"]
    return "\n".join([f"{key},{_PRIORS}", *(f"{cell},{_PRIOR_ROW}" for cell in cells), ""]).encode()


def read_as_odometry(path: Path) -> object:
    return read_odometry(path, SCANS, 0.01, 0.001)


def _summary(path: Path) -> SurveySummary:
    """Read a summary with the table of pairs beside it."""
    path.with_name("pairs.csv").write_text(_PAIRS)
    return read_summary(path)


POSE_FILES = {
    "tum": Readable("poses.tum", _TUM.encode(), read_tum),
    "kitti": Readable("poses.kitti", (" ".join(_ROWS.split()[:12]) + "\n").encode() * 2, read_kitti),
    "gt.log": Readable("gt.log", f"0 1 3\n{_ROWS}\n1 2 3\n{_ROWS}\n".encode(), read_gt_log),
    "g2o": Readable("graph.g2o", _G2O.encode(), read_g2o),
    "g2o of GTSAM": Readable("graph.g2o", GTSAM.encode(), read_g2o),
    "graph.json": Readable("graph.json", json.dumps(_GRAPH).encode(), read_graph_json),
    "summary.json": Readable("summary.json", json.dumps(_SUMMARY).encode(), _summary),
    "pairs.csv": Readable("pairs.csv", _PAIRS.encode(), lambda path: read_pairs(path, 2)),
    "description.json": Readable("description.json", json.dumps(_DESCRIPTION).encode(), read_settings),
    "priors by name": Readable("priors.csv", _csv("name"), lambda path: navigate(SCANS, path).scans),
    "priors by stamp": Readable("priors.csv", _csv("stamp"), lambda path: navigate(SCANS, path).scans),
    "odometry.csv": Readable(
        "odometry.csv",
        b"stamp,roll_deg,pitch_deg,heading_deg,x_m,y_m,depth_m\n0,1,2,30,4,5,6\n1,1,2,30,5,5,6\n2,1,2,30,6,5,6\n",
        read_as_odometry,
    ),
    "odometry.tum": Readable("odometry.tum", _TUM.encode(), read_as_odometry),
    "ties.csv": Readable("ties.csv", _TIES.encode(), lambda path: read_ties(path, SCANS)),
    "control.csv": Readable("control.csv", _CONTROL.encode(), lambda path: read_control(path, SCANS).points),
    "control on the Earth": Readable("earth.csv", _EARTH.encode(), lambda path: read_control(path, SCANS).points),
}  # fmt: skip


def numbers_in(result: Any, name: str = "") -> Iterator[np.ndarray]:
    """All numbers of a result, except those of UNKNOWN fields."""
    if name in UNKNOWN or result is None or isinstance(result, str):
        return
    if isinstance(result, RigidTransform):
        yield result.as_matrix()
    elif is_dataclass(result):
        for field in fields(result):
            yield from numbers_in(getattr(result, field.name), field.name)
    elif isinstance(result, tuple | list):
        for item in result:
            yield from numbers_in(item, name)
    else:
        yield np.asarray(result, np.float64)
