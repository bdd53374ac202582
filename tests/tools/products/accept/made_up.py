"""A made-up map folder: a sloping bed, seen by four scans in strips from known poses."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.tables import write_json

VOXEL, NOISE = 0.5, 0.01  # [m]
SLOPE = np.array([0.06, -0.03])
DEPTH = 7.3  # at the origin [m]
SIZE = 14.0, 9.0  # East and North [m]
POSES = RigidTransform.from_components(
    np.array([[1.5, 3.0, -1.0], [5.0, 4.0, -1.2], [8.5, 5.0, -0.9], [12.5, 4.0, -1.1]]),
    Rotation.from_euler("ZYX", [[10, 4, -3], [14, 3, -5], [-9, -4, 6], [21, 2, 4]], degrees=True),
)
SIGMAS = np.array([0.004, 0.006, 0.02, 0.3, 0.2])  # of the priors: roll, pitch, heading, East, North [rad, m]
EDGE = np.diag([1e-3, 2e-3, 1.5e-3, 0.03, 0.02, 0.015]) ** 2


def bed(noise: float = NOISE, seed: int = 4) -> np.ndarray:
    """Points (M, 3) [m] of the bed, two for each cell of half a meter."""
    rng = np.random.default_rng(seed)
    low = np.stack(np.meshgrid(*(np.arange(0, edge, VOXEL) for edge in SIZE), indexing="ij"), -1).reshape(-1, 2)
    flat = np.repeat(low, 2, axis=0) + rng.uniform(0.0, VOXEL, (2 * len(low), 2))
    return np.column_stack([flat, flat @ SLOPE - DEPTH + rng.normal(0.0, noise, len(flat))])


def strip(points: np.ndarray) -> np.ndarray:
    """(M,) int, the scan of each point (M, 3)."""
    return np.clip((points[:, 0] / SIZE[0] * len(POSES)).astype(np.int32), 0, len(POSES) - 1)


def map_folder(out: Path, points: np.ndarray | None = None, seen: int = 3, up: float = 0.05, **summary: Any) -> Path:
    """Write the folder; `up` is the priors' sigma of Up [m]. `summary` replaces keys of summary.json, and `unmeasured`
    that of its component."""
    points = bed() if points is None else points
    out.mkdir(parents=True)
    counts = {name: np.full(len(points), k, np.int32) for name, k in {"count": 5, "seen": seen, "survey": 0}.items()}
    sigma = np.full(len(points), 0.1, np.float32)
    write_ply(out / "map.ply", points, {**counts, "sigma": sigma, "scan": strip(points)})
    scans, matrices = list(range(len(POSES))), POSES.as_matrix()
    rows = [
        {
            "index": k,
            "name": f"scan_{k}",
            "stamp": float(k),
            "survey": 0,
            "in_world": True,
            "T_world_sensor": matrices[k],
        }
        for k in scans
    ]
    graph = {
        "format": "sonarmap graph 1",
        "poses": [{**row, "covariance": 1e-4 * np.eye(6)} for row in rows],
        "edges": [
            {"i": i, "j": j, "kind": "sequential", "covariance": EDGE, "probability": 1.0, "reason": ""}
            | {"T_i_j": (POSES[i].inv() * POSES[j]).as_matrix()}
            for i, j in pairwise(scans)
        ],
        "pairs": [],
        "priors": [{"pose": k, "T_world_sensor": matrices[k], "sigmas": [*SIGMAS, up]} for k in scans],
        "crossings": [{"i": 0, "j": 2, "after_m": 0.034}, {"i": 1, "j": 3, "after_m": 0.051}],
    }
    write_json(out / "graph.json", graph)
    component = {"scans": scans, "unmeasured": summary.pop("unmeasured", []), "map": {"voxel_m": VOXEL}}
    write_json(out / "summary.json", {"components": [component], "files": ["map.ply"], **summary})
    return out
