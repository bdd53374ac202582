"""A point cloud of another program as one of the two surveys: its points are known, but not its sensor's poses."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.locate.surveyed_map import SurveyedMap, View
from sonarmap.slam.map.cell import cell_keys, lattice_origin
from sonarmap.tools.files.geo import DEFAULT_VERTICAL, Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.readers.clouds.las import crs_of, read_las, read_map_las
from sonarmap.tools.files.readers.file import FORMATS
from sonarmap.tools.files.user_file import naming, read_content

if TYPE_CHECKING:
    from pyproj import CRS

Given: TypeAlias = Map | np.ndarray | str | os.PathLike[str]

_READERS = {suffix: each.read for suffix, each in FORMATS.items() if each.read is not None}
_FEWEST, _FEW = 50, 2.0  # least number of voxels with points; points per voxel below which a cloud counts as thinned
_LARGE, _ROUND = 1e4, 1000.0  # coordinates beyond the first are counted from an origin, a multiple of the second [m]
_INNER, _OTHER_UNIT = (0.05, 0.95), 100.0  # quantiles of a cloud's extent; ratio to the map's that is another unit
# Spacing of virtual viewpoints: share of the reach of the map's views, and minimum [voxels]; their range [spacings]
_APART, _LEAST_APART, _RADIUS = 0.5, 8.0, 1.2


@dataclass(frozen=True, slots=True)
class PointCloud:
    path: Path  # of its file
    points: np.ndarray  # (M, 3) float64 mean of the points in each voxel [m], in the local frame that `notes` describe
    weight: np.ndarray  # (M,) float64, number of points in each voxel
    voxel: float  # edge of a voxel, that of the other survey's map [m]
    sigma: float | None  # standard deviation of a coordinate [m]; None to estimate it from the scatter
    georeference: Georeference | None  # of the local frame, East-North-Up; None without a CRS
    notes: tuple[str, ...]  # remarks for the user, one sentence each

    @classmethod
    def read(cls, path: Path, beside: Map, sigma: float | None = None) -> "PointCloud":
        """Read the cloud of a file, to be compared with the map `beside`."""
        if (read := _READERS.get(path.suffix.lower())) is None:
            raise InputError(
                f"{path} is neither the folder of a finished map nor a file of points, as {', '.join(_READERS)}"
            )
        content, is_las = read_content(path), read is read_las
        with naming(path):
            (cloud,) = read_map_las(content) if is_las else read(content)
            return cls.of_points(cloud.points, beside, sigma, path, crs_of(content) if is_las else None)

    @classmethod
    def of_points(
        cls, given: np.ndarray, beside: Map, sigma: float | None = None, path: Path = Path("points"), crs: Any = None
    ) -> "PointCloud":
        """The cloud of points (N, 3) [m] in a pyproj CRS, or in their own frame for None."""
        if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "fiu":
            raise InputError(f"an array of {given.dtype} of shape {given.shape}; wanted numbers (N, 3) in meters")
        points = given[np.isfinite(given).all(axis=1)].astype(np.float64)
        here, notes = None, [f"errors of the poses of {path} are not known, and not in the level of detection"]
        if len(points) < len(given):
            notes.append(f"{path}: dropped {len(given) - len(points):,} points that are NaN or infinite")
        if crs is not None and len(points):
            vertical = DEFAULT_VERTICAL if beside.georeference is None else beside.georeference.vertical
            here, points = _local(points, crs, vertical)
            notes.append(
                f"{path}: its frame is East-North-Up about {here.latitude:.7f}, {here.longitude:.7f}, and its heights "
                f"are taken to count from {vertical!r}, as the map's do"
            )
        elif len(points) and np.abs(points).max() > _LARGE:
            origin = np.round(np.median(points, axis=0) / _ROUND) * _ROUND
            points -= origin
            notes.append(f"{path}: its coordinates are counted from {', '.join(f'{x:z.0f}' for x in origin)} m")
        means, weight = _thinned(points, beside.voxel)
        if len(means) < _FEWEST:
            raise InputError(
                f"it has finite points in {len(means)} voxels of the map; wanted {_FEWEST} or more: check its unit"
            )
        if sigma is None and weight.mean() < _FEW:  # of such a cloud the scatter is no measure: strays weigh too much
            sigma = beside.voxel
            notes.append(
                f"{path}: it seems to be thinned ({weight.mean():.1f} points in a voxel), so its sigma is set to "
                f"{sigma:.2f} m; give all of its points, or --cloud-sigma"
            )
        cloud = cls(path, means, weight, beside.voxel, sigma, here, tuple(notes))
        ours, theirs = cloud.extents(beside)
        if ours > _OTHER_UNIT * theirs:
            raise InputError(
                f"it extends over {ours:,.0f} m, the map over {theirs:,.0f} m; wanted meters, and the map's area"
            )
        return cloud

    def extents(self, beside: Map) -> list[float]:
        """Largest extents of the cloud and of the map `beside` it [m], without strays."""
        clouds = self.points, beside.parts[0].points
        return [float(np.ptp(np.quantile(points, _INNER, axis=0), axis=0).max()) for points in clouds]

    def seen_as(self, real: SurveyedMap) -> "CloudMap":
        """The cloud as a map in which views of the map `real` are located. Its viewpoints are virtual, as the true ones
        are unknown: one amid the points of each square, which sees a ball."""
        reach = float(np.median([real.view_of(key).reach for key in real.apart]))
        apart = max(_APART * reach, _LEAST_APART * self.voxel)
        cells = np.floor(self.points[:, :2] / apart)
        _, square, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        places = np.column_stack([np.bincount(square.ravel(), axis) for axis in self.points.T]) / count[:, None]
        seen_by, T = np.asarray(KDTree(places).query(self.points)[1]), RigidTransform.from_translation(places)
        exact, unmeasured = np.zeros((len(places), 6, 6)), np.zeros(6, bool)
        return CloudMap(self.points, seen_by, T, exact, self.voxel, unmeasured, _RADIUS * apart)


@dataclass(frozen=True, slots=True)
class CloudMap(SurveyedMap):
    """A cloud as a map, seen from virtual viewpoints."""

    radius: float  # of the ball seen from each viewpoint [m]

    def view_of(self, key: int) -> View:
        """The ball around the viewpoint."""
        return View(self.radius, np.array([0.0, 0.0, 1.0]), -1.0)


def opened_surveys(
    old: Given, new: Given, sigma: float | None, open_map: Callable[[Any], Map]
) -> tuple[Map | PointCloud, Map | PointCloud, Map]:
    """The old and the new survey, and the one of them that is a map, of two the old one. At most one may be a cloud, a
    file or points (N, 3) [m]; `open_map` opens maps."""
    old_is_cloud, new_is_cloud = _is_cloud(old), _is_cloud(new)
    if old_is_cloud and new_is_cloud:
        raise InputError(
            "both are point clouds; wanted the folder of a finished map for one of them, as only maps have poses"
        )
    beside, other = open_map(new if old_is_cloud else old), cast("Any", old if old_is_cloud else new)
    if not (old_is_cloud or new_is_cloud):
        if sigma is not None:
            raise InputError("--cloud-sigma has no effect without a point cloud; leave it out")
        return beside, open_map(new), beside
    is_array = isinstance(other, np.ndarray)
    cloud = PointCloud.of_points(other, beside, sigma) if is_array else PointCloud.read(Path(other), beside, sigma)
    return (cloud, beside, beside) if old_is_cloud else (beside, cloud, beside)


def _is_cloud(given: Given) -> bool:
    """Whether an argument is an array or a file of points, and not a map or its folder."""
    if isinstance(given, np.ndarray | Map):
        return isinstance(given, np.ndarray)
    return Path(given).is_file() or (Path(given).suffix.lower() in _READERS and not Path(given).is_dir())


def _local(points: np.ndarray, crs: "CRS", vertical: str) -> tuple[Georeference, np.ndarray]:
    """East-North-Up frame about the middle of points (N, 3) of a CRS, and the points in it."""
    whole = crs.source_crs if crs.is_bound and crs.source_crs is not None else crs
    flat = whole.sub_crs_list[0] if whole.is_compound else whole.to_2d()
    units = {axis.unit_name for axis in whole.axis_info}
    if not flat.is_projected or units != {"metre"}:
        raise InputError(
            f"its coordinates are of {crs.name}; wanted a projected CRS in meters, such as the UTM zone: reproject it"
        )
    projection = Projection(flat, vertical)
    latitude, longitude, _ = projection.unproject(np.median(points, axis=0)[None])[0].tolist()
    here = Georeference(latitude, longitude, 0.0, vertical)
    return here, here.local(projection.unproject(points))


def _thinned(points: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Means (M, 3) of points [m] in the cells that hold any, and numbers of these points (M,); strays are left out."""
    keys, near = cell_keys(points, cell, lattice_origin(points, cell) if len(points) else np.zeros(3))
    _, number, count = np.unique(keys, return_inverse=True, return_counts=True)
    means = np.column_stack([np.bincount(number, axis, len(count)) for axis in points[near].T]) / count[:, None]
    return means, count.astype(np.float64)
