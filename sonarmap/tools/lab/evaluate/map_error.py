"""Distances of a map's points from a reference: the true surface or a reference point cloud."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.file import FORMATS, clouds_of
from sonarmap.tools.files.readers.selection import SelectedFile

Nearest = Literal["surface", "point"]


@dataclass(frozen=True, slots=True)
class Reference:
    """A surface or point cloud that a map is compared with, in the frame of the true trajectory."""

    name: str  # description for the user
    nearest: Nearest  # "surface", exact distances to triangles, or "point", to the nearest point of a cloud
    distance: Callable[[np.ndarray], np.ndarray]  # maps points (N, 3) [m] to distances (N,) float64 [m]


@dataclass(frozen=True, slots=True)
class MapError:
    """Distances of a map's M points from a reference."""

    reference: str  # its description for the user
    nearest: Nearest  # what the distances are measured to, see Reference
    distance_m: np.ndarray  # (M,) float64 [m]
    voxel: float  # edge of the map's voxels [m]

    @property
    def median_m(self) -> float:
        """Median distance [m]."""
        return float(np.median(self.distance_m))

    @property
    def p90_m(self) -> float:
        """90th percentile of the distances [m]."""
        return float(np.quantile(self.distance_m, 0.9))

    @property
    def within_voxel(self) -> float:
        """Share of the points that lie within one voxel, 0..1."""
        return float((self.distance_m <= self.voxel).mean())

    def to_json(self) -> dict[str, Any]:
        """The median, the 90th percentile, the share within a voxel, and what they refer to."""
        return {
            "reference": self.reference,
            "nearest": self.nearest,
            "points": len(self.distance_m),
            "median_m": self.median_m,
            "p90_m": self.p90_m,
            "within_voxel": self.within_voxel,
            "voxel_m": self.voxel,
        }


def map_error(points: np.ndarray, reference: Reference, voxel: float) -> MapError:
    """Compare the points (M, 3) [m] of a map, aligned with the truth, with a reference; `voxel` is the map's [m]."""
    return MapError(reference.name, reference.nearest, reference.distance(points), voxel)


def reference_of(path: Path) -> Reference:
    """Build the true surface of a simulation from its folder or description.json, or read the points of a cloud's file.
    Raises InputError: the path is none of these, or cannot be read."""
    from sonarmap.tools.lab.simulate.folder import DESCRIPTION, read_settings

    description = path / DESCRIPTION if path.is_dir() else path
    if description.suffix.lower() == ".json":
        from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance

        settings = read_settings(description)
        mesh = build_scene(settings.scene, settings.seed).mesh
        name = f"the true surface of {settings.scene}, seed {settings.seed}"
        return Reference(name, "surface", lambda points: surface_distance(mesh, points))
    if path.suffix.lower() not in FORMATS:
        raise InputError(
            f"{path} cannot be compared with a map; wanted a simulation's folder or description.json, or points in "
            f"{', '.join(FORMATS)}"
        )
    tree = KDTree(read_points(path))
    return Reference(f"the {tree.n} points of {path.name}", "point", lambda points: tree.query(points)[0])


def read_points(path: Path) -> np.ndarray:
    """All finite points (M, 3) float64 [m] of a file. Raises InputError: there are none, or as in `clouds_of`."""
    clouds = list(clouds_of(SelectedFile(path), []))
    points = np.concatenate([np.asarray(named.cloud.points, np.float64) for named in clouds])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        raise InputError(f"{path}: none of its points is finite; give a map with points")
    return points
