"""Maps of known points, as they are read from a folder."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.products.section import PlacedMap


def placed(
    points: np.ndarray,
    sigma: np.ndarray | float = 0.1,
    scan: np.ndarray | int = 0,
    poses: RigidTransform | None = None,
    covariances: np.ndarray | None = None,
    georeference: Georeference | None = None,
    voxel: float = 0.5,
) -> PlacedMap:
    """Map of these points (M, 3) [m]; by default with one pose at the origin, without uncertainty."""
    poses = RigidTransform.from_translation(np.zeros((1, 3))) if poses is None else poses
    count = len(points)
    columns = {
        "count": np.full(count, 3, np.int32),
        "seen": np.full(count, 2, np.int32),
        "sigma": np.broadcast_to(np.asarray(sigma, np.float32), count).copy(),
        "scan": np.broadcast_to(np.asarray(scan, np.int32), count).copy(),
        "survey": np.zeros(count, np.int32),
    }
    part = MapPart(
        suffix="",
        points=np.asarray(points, np.float64),
        columns=columns,
        scans=tuple(range(len(poses))),
        trajectory=Trajectory(np.arange(len(poses), dtype=np.float64), poses),
        covariances=np.zeros((len(poses), 6, 6)) if covariances is None else covariances,
        in_world=georeference is not None,
    )
    return PlacedMap(Path("made-up"), part, voxel, georeference)


def bed(height: float = -10.0, columns: int = 10, rows: int = 8) -> np.ndarray:
    """Points (columns * rows, 3) [m] at the centers of 1 m cells, from the origin on."""
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


def moved(map_: PlacedMap, points: np.ndarray) -> PlacedMap:
    """The same map with other points."""
    return replace(map_, part=replace(map_.part, points=points))
