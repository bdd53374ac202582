"""One of two compared surveys with the joint covariance of its poses, and its surface at core points.

Surfaces follow M3C2 (Lague, Brodu and Leroux, DOI 10.1016/j.isprsjprs.2013.04.009): the mean of the points in a
cylinder along the local normal of each core point. There are two differences. Points are weighted by their numbers of
echoes, because noise spreads a map's surface over several voxels with few echoes in the outer ones. And of several
layers in a cylinder, such as a gate's two sides or a bed below a deck, only the one with most points counts. The share
of each scan in a mean is kept, because the points of a scan have a common error.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.pose_covariance import joint_covariance
from sonarmap.slam.graph.tangent import adjoint, propagated
from sonarmap.tools.files.map_folder.folder import Map, map_points
from sonarmap.tools.files.map_folder.names import FULL_GRAPH
from sonarmap.tools.files.readers.trajectory import read_graph_json

_LEAST_NOISE = 1e-3  # [m]
_PASSING = 2  # least number of sight lines through a free place: a single one may end at a stray echo
_MOST = 300  # largest number of poses with errors; in a longer survey they represent their neighbors
NORMAL_RADIUS, RADIUS = 2.5, 1.5  # of the neighborhood of normals, and of cylinders [voxels]
FEWEST = 4  # least number of points in a cylinder
_HALF = 1.5  # half thickness of a layer [voxels]
_GAP = 1.0  # least gap between two layers [voxels]
_CHUNK = 20_000  # core points that are treated at a time


@dataclass(frozen=True, slots=True)
class Epoch:
    """A survey of M points, and n of its poses, each of which represents its neighbors."""

    points: np.ndarray  # (M, 3) float64 [m]
    noise: np.ndarray  # (M,) float64 standard deviation of a coordinate [m], without the errors of the poses
    weight: np.ndarray  # (M,) float64, number of echoes whose mean the point is
    scan: np.ndarray  # (M,) int64, 0..n-1, index of the pose that represents the point's main scan
    origins: np.ndarray  # (M, 3) float64 [m], positions of the sensor that saw the points
    # (6 n, 6 n) of the poses' errors, rotation first [rad, m], left tangents: (w, v) moves a point p by w x p + v
    covariance: np.ndarray
    sides_known: bool = True  # whether the origins are known; else they are those of nearby points

    @property
    def poses(self) -> int:
        """Number of poses, n."""
        return len(self.covariance) // 6

    @classmethod
    def of_map(cls, folder: Map, survey: int | None = None) -> "Epoch":
        """The largest part of a finished map, or the points that one of its surveys saw of it, in its frame."""
        part = folder.parts[0]
        points, columns = part.points, part.columns
        if survey is not None:
            points, columns = map_points(folder.path / f"map{part.suffix}_survey_{survey}.ply", part.scans)
        count = len(part.scans)
        chosen = np.unique(np.linspace(0, count - 1, min(_MOST, count)).round().astype(np.intp))
        joint = joint_covariance(read_graph_json(folder.path / FULL_GRAPH), np.array(part.scans)[chosen].tolist())
        nearest = np.searchsorted((chosen[1:] + chosen[:-1]) / 2, np.arange(count))
        scan = nearest[np.searchsorted(part.scans, columns["scan"])]
        T = part.trajectory.T_world_sensor[chosen]
        by_poses = _pose_variance(points, scan, propagated(T, part.covariances[chosen]))
        noise = np.sqrt(np.maximum(columns["sigma"].astype(np.float64) ** 2 - by_poses, _LEAST_NOISE**2))
        weight = np.maximum(columns["count"].astype(np.float64), 1.0)
        return cls(points, noise, weight, scan, T.translation[scan], joint)

    @classmethod
    def of_cloud(cls, points: np.ndarray, weight: np.ndarray, sigma: float | None, beside: "Epoch") -> "Epoch":
        """A cloud without poses and hence without their errors, in the frame of the survey `beside`. It takes the
        origins of that survey's nearest points; `sigma` is that of a single point [m]."""
        noise = np.maximum((sigma or 0.0) / np.sqrt(weight), _LEAST_NOISE)
        near = KDTree(beside.points).query(points)[1]
        scan, exact = np.zeros(len(points), np.int64), np.zeros((6, 6))
        return cls(points, noise, weight, scan, beside.origins[near], exact, sides_known=False)

    def passes(self, places: np.ndarray, voxel: float) -> np.ndarray:
        """(n,) bool: which places (n, 3) [m] the survey saw free, with no point within a voxel and sight lines through
        them to points behind."""
        free = ~np.isfinite(KDTree(self.points).query(places, distance_upper_bound=voxel)[0])
        viewpoints, which = np.unique(self.origins, axis=0, return_inverse=True)
        passing = np.zeros(len(places), np.int64)
        for number, viewpoint in enumerate(viewpoints):
            toward, offset = places - viewpoint, self.points[which.ravel() == number] - viewpoint
            distance, ranges = np.linalg.norm(toward, axis=1), np.linalg.norm(offset, axis=1)
            lines = KDTree(offset / ranges[:, None])
            for at in np.flatnonzero(free & (distance > voxel) & (distance + voxel < ranges.max())).tolist():
                near = lines.query_ball_point(toward[at] / distance[at], voxel / distance[at])
                passing[at] += np.count_nonzero(ranges[near] > distance[at] + voxel)
        return passing >= _PASSING

    def moved(self, T_other_this: RigidTransform) -> "Epoch":
        A = block_diag(*[adjoint(T_other_this)] * self.poses)
        return replace(
            self,
            points=T_other_this.apply(self.points),
            origins=T_other_this.apply(self.origins),
            covariance=A @ self.covariance @ A.T,
        )


def levers(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(K, 6) motion of points (K, 3) along normals (K, 3) by an error (w, v), left tangent: w . (p x n) + v . n."""
    return np.hstack([np.cross(points, normals), normals])


def _pose_variance(points: np.ndarray, scan: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(M,) mean variance of the coordinates of points (M, 3) [m^2] by covariances (n, 6, 6) of poses, left tangents."""
    total = np.zeros(len(points))
    for axis in np.eye(3):
        J = levers(points, np.broadcast_to(axis, points.shape))
        for pose in range(len(covariances)):
            members = scan == pose
            total[members] += np.einsum("ka,ab,kb->k", J[members], covariances[pose], J[members])
    return np.maximum(total, 0.0) / 3


@dataclass(frozen=True, slots=True)
class Cores:
    points: np.ndarray  # (K, 3) float64 [m]
    normals: np.ndarray  # (K, 3) unit, toward the sensor
    area: np.ndarray  # (K,) float64, area that each core point represents [m^2]

    def take(self, chosen: np.ndarray) -> "Cores":
        """The chosen core points, by indices or (K,) bool."""
        return Cores(self.points[chosen], self.normals[chosen], self.area[chosen])


@dataclass(frozen=True, slots=True)
class Layer:
    """Means of a cloud in the cylinders of K core points; NaN where there are fewer than FEWEST points."""

    height: np.ndarray  # (K,) float64 weighted mean along the normal, from the core point [m]
    variance: np.ndarray  # (K,) float64 of the height by noise and roughness [m^2], without the errors of poses
    count: np.ndarray  # (K,) int64, number of points, also where there are too few
    shares: Any  # sparse (K, n) share of each pose in the weight


def cores_of(epoch: Epoch, voxel: float) -> Cores:
    """Core points of a cloud, one for each voxel of its surface."""
    points = epoch.points
    normals, _ = planes_at(epoch, points, voxel)
    flipped = np.einsum("ka,ka->k", normals, epoch.origins - points) < 0
    normals[flipped] *= -1
    height = layer_of(epoch, Cores(points, normals, np.ones(len(points))), voxel, 0.0).height
    usable = np.isfinite(height)
    return _thinned(points[usable] + height[usable, None] * normals[usable], normals[usable], voxel)


def planes_at(epoch: Epoch, places: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """Planes fitted to a cloud around each place (K, 3) [m]: unit normals (K, 3) of either sign, and RMS distances of
    the points (K,) [m]; NaN where there are none."""
    normals, rough = np.empty_like(places), np.empty(len(places))
    for chunk, core, near in _neighbors(epoch.points, places, NORMAL_RADIUS * voxel):
        weight, size = epoch.weight[near], chunk.stop - chunk.start
        offset = epoch.points[near] - places[chunk][core]
        total = np.bincount(core, weight, size)
        offset -= np.column_stack([np.bincount(core, weight * x, size) for x in offset.T])[core] / total[core, None]
        moments = [np.bincount(core, weight * offset[:, a] * offset[:, b], size) for a in range(3) for b in range(3)]
        spread, axes = np.linalg.eigh(np.column_stack(moments).reshape(-1, 3, 3))
        normals[chunk] = axes[:, :, 0]
        with np.errstate(invalid="ignore"):
            rough[chunk] = np.sqrt(np.maximum(spread[:, 0], 0.0) / total)
    return normals, rough


def _thinned(points: np.ndarray, normals: np.ndarray, voxel: float) -> Cores:
    """Core points thinned from surface points (N, 3): one per surface in each column of one voxel by one, along the
    axis nearest to the normal."""
    axis = np.abs(normals).argmax(axis=1)
    row = np.arange(len(points))
    cell = np.floor(points / voxel).astype(np.int64)
    height = points[row, axis]
    cell[row, axis] = 0
    order = np.lexsort((height, cell[:, 2], cell[:, 1], cell[:, 0], axis))
    column = np.column_stack([axis, cell])[order]
    starts = np.ones(len(points), bool)
    starts[1:] = (column[1:] != column[:-1]).any(axis=1) | (np.diff(height[order]) > _GAP * voxel)
    first = np.flatnonzero(starts)
    middle = (first + np.append(first[1:], len(points)) - 1) // 2
    chosen = order[middle]
    return Cores(points[chosen], normals[chosen], voxel**2 / np.abs(normals[chosen, axis[chosen]]))


def layer_of(epoch: Epoch, cores: Cores, voxel: float, reach: float) -> Layer:
    """Layer of a cloud in each cylinder, up to `reach` [m] to either side along the normal, from points that were seen
    from the normal's side."""
    radius, half = RADIUS * voxel, _HALF * voxel
    size, scans = len(cores.points), epoch.poses
    height, variance, count = np.full(size, np.nan), np.full(size, np.nan), np.zeros(size, np.int64)
    shares: list[Any] = []
    for chunk, core, near in _neighbors(epoch.points, cores.points, float(np.hypot(radius, reach + half))):
        offset = epoch.points[near] - cores.points[chunk][core]
        along = np.einsum("pa,pa->p", offset, cores.normals[chunk][core])
        inside = (np.einsum("pa,pa->p", offset, offset) - along**2 <= radius**2) & (np.abs(along) <= reach + half)
        core, near, along = core[inside], near[inside], along[inside]
        toward = epoch.origins[near] - epoch.points[near]
        inside = np.einsum("pa,pa->p", toward, cores.normals[chunk][core]) > 0
        core, near, along = core[inside], near[inside], along[inside]
        length = chunk.stop - chunk.start
        middle = _largest_layer(core, along, epoch.weight[near], length, voxel)
        inside = np.abs(along - middle[core]) <= half  # NaN is not
        core, near, along = core[inside], near[inside], along[inside]
        weight = epoch.weight[near]
        number, total = np.bincount(core, minlength=length), np.bincount(core, weight, length)
        enough = number >= FEWEST
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(core, weight * along, length) / total
            scatter = np.bincount(core, weight * (along - mean[core]) ** 2, length) / total
            noise = np.bincount(core, (weight * epoch.noise[near]) ** 2, length) / total**2
            rough = scatter * np.bincount(core, weight**2, length) / total**2
        count[chunk] = number
        height[chunk] = np.where(enough, mean, np.nan)
        variance[chunk] = np.where(enough, np.maximum(noise, rough * number / np.maximum(number - 1, 1)), np.nan)
        share = weight / total[core]
        shares.append(sparse.coo_array((share, (core, epoch.scan[near])), shape=(length, scans)).tocsr())
    stacked = sparse.vstack(shares, format="csr") if shares else sparse.csr_array((0, scans))
    return Layer(height, variance, count, stacked)


def faced(cores: Cores, others: Cores, voxel: float, reach: float) -> np.ndarray:
    """(K,) bool: which core points have one of `others` before or behind them along the normal, up to `reach` [m]."""
    found = np.zeros(len(cores.points), bool)
    for chunk, core, near in _neighbors(others.points, cores.points, float(np.hypot(voxel, reach))):
        offset = others.points[near] - cores.points[chunk][core]
        along = np.einsum("pa,pa->p", offset, cores.normals[chunk][core])
        beside = np.einsum("pa,pa->p", offset, offset) - along**2
        found[chunk][core[(beside <= voxel**2) & (np.abs(along) <= reach)]] = True
    return found


def _largest_layer(core: np.ndarray, along: np.ndarray, weight: np.ndarray, size: int, voxel: float) -> np.ndarray:
    """(size,) middle along the normal of the layer with most points around each core point, of equal ones the nearest.
    Gaps separate layers; NaN where none has FEWEST points."""
    order = np.lexsort((along, core))
    core, along, weight = core[order], along[order], weight[order]
    new = np.ones(len(core), bool)
    new[1:] = (np.diff(core) > 0) | (np.diff(along) > _GAP * voxel)
    layer = np.cumsum(new) - 1
    owner, number = core[new], np.bincount(layer)
    # of a layer through the core point only nearby points count, as in the survey that the core point is from
    near = np.abs(along) <= _HALF * voxel
    weight = np.where(near | ~(np.bincount(layer, near) > 0)[layer], weight, 0.0)
    middle = np.bincount(layer, weight * along) / np.maximum(np.bincount(layer, weight), 1e-300)
    usable = np.flatnonzero(number >= FEWEST)
    largest = usable[np.lexsort((np.abs(middle[usable]), -number[usable], owner[usable]))]
    owners, first = np.unique(owner[largest], return_index=True)
    result = np.full(size, np.nan)
    result[owners] = middle[largest[first]]
    return result


def _neighbors(cloud: np.ndarray, cores: np.ndarray, radius: float) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Pairs of core points and points of the cloud within a radius [m]: a slice of the core points, indices into the
    slice, and indices of points."""
    tree = KDTree(cloud)
    for start in range(0, len(cores), _CHUNK):
        chunk = slice(start, min(start + _CHUNK, len(cores)))
        pairs = KDTree(cores[chunk]).sparse_distance_matrix(tree, radius, output_type="ndarray")
        yield chunk, pairs["i"], pairs["j"]
