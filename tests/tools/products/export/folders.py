"""Made-up maps to export."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
from sonarmap.tools.products.export.georeferenced import Georeferenced


def timed(earth: Georeferenced, stamps: np.ndarray) -> Georeferenced:
    """The same with other stamps."""
    trajectory = replace(earth.part.trajectory, stamps=stamps)
    return replace(earth, part=replace(earth.part, trajectory=trajectory))


def georeferenced(here: Georeference, T_world_sensor: RigidTransform, points: int = 500) -> Georeferenced:
    """A map of one part with these poses, and random points about them."""
    rng = np.random.default_rng(3)
    count = len(T_world_sensor)
    middle = T_world_sensor.translation[rng.integers(0, count, points)]
    columns = {
        "count": rng.integers(1, 90, points).astype(np.int32),
        "seen": rng.integers(1, 9, points).astype(np.int32),
        "sigma": rng.uniform(0.01, 0.3, points).astype(np.float32),
        "scan": rng.integers(0, count, points).astype(np.int32),
        "survey": np.zeros(points, np.int32),
        "intensity": rng.uniform(0, 900, points).astype(np.float32),
    }
    part = MapPart(
        suffix="",
        points=middle + rng.uniform(-8, 8, (points, 3)),
        columns=columns,
        scans=tuple(range(count)),
        trajectory=Trajectory(1.7e9 + np.arange(count) * 2.5, T_world_sensor),
        covariances=np.tile(np.diag([1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.03]), (count, 1, 1)),
        in_world=True,
    )
    folder = MapFolder(Path("made-up"), tuple(f"scan_{k}" for k in range(count)), (part,), (), 0.2, {}, here, {})
    return Georeferenced(folder, part, here, Projection.of(here))
